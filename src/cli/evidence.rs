//! What the commands that verify are given: public keys, and receipts as they were handed out.

use serde_json::Value;

use crate::clock::{milliseconds, rfc3339};
use plumbline_engine::hidden::FIRST_WITH_PROMPTS;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::evidence::{DrawFact, GivenReceipt, prompts_hash};

/// Parses a public key.
pub(super) fn key(text: &str) -> Result<String, &'static str> {
    let is_key = unhex::<32>(text.trim()).is_some();
    is_key.then(|| text.trim().to_ascii_lowercase()).ok_or("expected 64 hexadecimal digits")
}

/// Returns whether this is the reveal of an epoch, which other commands are given by mistake.
pub(super) fn is_reveal(value: &Value) -> bool {
    ["key", "specifications", "instances"].iter().all(|name| value.get(name).is_some())
}

/// Reads a receipt as the service returned it: alone, or inside the response to the step that it confirms.
pub(super) fn read_given(value: &Value) -> Option<GivenReceipt> {
    let inner = value.get("receipt").filter(|inner| inner.get("signature").is_some());
    serde_json::from_value(inner.unwrap_or(value).clone()).ok()
}

/// Returns the receipts in a value, each with the response that has it: the value itself, or parts of it, as in a line of a
/// journal.
pub(super) fn handed_out_in(value: &Value) -> Vec<(&Value, GivenReceipt)> {
    if let Some(given) = read_given(value) {
        return vec![(value, given)];
    }
    match value {
        Value::Array(items) => items.iter().flat_map(handed_out_in).collect(),
        Value::Object(members) => members.values().flat_map(handed_out_in).collect(),
        _ => Vec::new(),
    }
}

/// Compares the instances of the response to a draw with what its receipt states, and their times with the rules of the
/// epoch. Returns what differs.
pub(super) fn drawn_otherwise(response: &Value, stated: &DrawFact, commitment: &Commitment) -> Option<String> {
    let protocol = commitment.protocol();
    let instances = response["instances"].as_array().map(Vec::as_slice).unwrap_or_default();
    if !instances.iter().map(|own| own["id"].as_str()).eq(stated.instances.iter().map(|id| Some(id.as_str()))) {
        return Some("it states other instances than the response has".to_owned());
    }
    // A copy that leaves a member out says nothing else.
    let differs = |found: &Value, wanted: Value| !found.is_null() && *found != wanted;
    if instances.iter().any(|own| differs(&own["run"], stated.run.into())) {
        return Some(format!("it states run {}, and the response another", stated.run));
    }
    if let Some(rules) = &commitment.rules {
        let expires = stated.drawn_at_ms + i64::from(rules.instance_seconds) * 1_000;
        let expires = expires.min(commitment.closes_at_ms);
        // A program that kept it may have written the same time in another way.
        let differs = |found: &Value| !found.is_null() && found.as_str().and_then(milliseconds) != Some(expires);
        if instances.iter().any(|own| differs(&own["expires_at"])) {
            return Some(format!(
                "by it and the rules of the epoch the instances expire at {}, not when the response says",
                rfc3339(expires)
            ));
        }
    }
    if stated.prompts_sha256.is_empty() && protocol < FIRST_WITH_PROMPTS {
        return None;
    }
    if stated.prompts_sha256.len() != instances.len() {
        return Some("it does not state the prompts of all instances".to_owned());
    }
    let mut each = instances.iter().zip(&stated.prompts_sha256);
    let other = each.find(|(instance, hash)| {
        let prompts = instance["prompts"].as_array();
        prompts.is_some_and(|prompts| {
            **hash != prompts_hash(prompts.iter().map(|prompt| prompt.as_str().unwrap_or_default()))
        })
    });
    other.map(|(instance, _)| format!("it states other prompts for instance {}", instance["id"]))
}
