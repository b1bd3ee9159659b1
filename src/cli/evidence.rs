//! What the commands that verify are given: public keys, and receipts as they were handed out.

use serde_json::Value;

use plumbline_engine::hidden::FIRST_WITH_PROMPTS;
use plumbline_engine::hidden::canonical::unhex;
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

/// Compares the instances of the response to a draw with what its receipt states. Returns what differs; `protocol` is that
/// of the epoch.
pub(super) fn drawn_otherwise(response: &Value, stated: &DrawFact, protocol: u32) -> Option<String> {
    let instances = response["instances"].as_array().map(Vec::as_slice).unwrap_or_default();
    if !instances.iter().map(|own| own["id"].as_str()).eq(stated.instances.iter().map(|id| Some(id.as_str()))) {
        return Some("it states other instances than the response has".to_owned());
    }
    if stated.prompts_sha256.is_empty() && protocol < FIRST_WITH_PROMPTS {
        return None;
    }
    if stated.prompts_sha256.len() != instances.len() {
        return Some("it does not state the prompts of all instances".to_owned());
    }
    let mut each = instances.iter().zip(&stated.prompts_sha256);
    let other = each.find(|(instance, hash)| {
        // A copy that leaves them out says nothing else.
        let prompts = instance["prompts"].as_array();
        prompts.is_some_and(|prompts| {
            **hash != prompts_hash(prompts.iter().map(|prompt| prompt.as_str().unwrap_or_default()))
        })
    });
    other.map(|(instance, _)| format!("it states other prompts for instance {}", instance["id"]))
}
