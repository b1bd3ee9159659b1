//! The bodies of requests about teams.

use serde_json::Value;

use crate::app::body::values::{Json, Parsed};
use crate::app::body::{name, request_body};
use crate::app::limits::LIMITS;
use crate::store::keys::{Role, Scope};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::Integer;
use plumbline_engine::text::did_you_mean;

request_body! {
    /// Role of a member.
    #[schema(as = NewMember, example = json!({ "role": "submitter" }))]
    pub struct NewMemberBody: "an object with \"role\"" {
        /// What the member's keys may do at most: `reader` grades within requests and reads; `submitter` also begins
        /// runs and posts submissions; `manager` also manages members, keys and webhooks, withdraws runs and lifts
        /// embargoes.
        #[schema(value_type = Role)]
        role: Role = required(|faults| Parsed { text: name(faults), parse: role_named }),
    }
    unknown: |_| "unknown field; a member has role"
}

request_body! {
    /// A key to create.
    #[derive(Default)]
    #[schema(as = NewKey, example = json!({ "scopes": ["submit"], "expires_days": 90 }))]
    pub struct NewKeyBody: "an object with \"scopes\" and \"expires_days\"" {
        /// Scopes of the key; by default all that the member's role and the key of the request allow.
        #[schema(value_type = Option<Vec<Scope>>)]
        scopes: Vec<Scope> = optional(|faults| Json { faults, read: read_scopes }),
        /// Lifetime of the key in days; by default, and at most, that of the key of the request.
        #[schema(value_type = Option<i64>, minimum = 1)]
        expires_days: i64 = optional(|faults| Integer { faults, min: 1, max: LIMITS.key_days }),
    }
    unknown: |_| "unknown field; a key has scopes and expires_days"
}

fn role_named(name: &str) -> Result<Role, String> {
    let known = Role::ALL.map(Role::name);
    Role::named(name).ok_or_else(|| format!("{name:?} is not one of {}{}", known.join(", "), did_you_mean(name, known)))
}

/// Reads a list of words, of which each must be known; adds the faults of all that are not.
pub fn read_words<T: Copy>(value: &Value, known: &[(&'static str, T)], faults: &mut Faults) -> Option<Vec<T>> {
    let Some(items) = value.as_array() else {
        faults.add("expected an array");
        return None;
    };
    if items.is_empty() {
        faults.add("expected one item or more; leave it out for all");
        return None;
    }
    let names = || known.iter().map(|(name, _)| *name);
    let mut found = Vec::new();
    for (i, item) in items.iter().enumerate() {
        let word = item.as_str().and_then(|text| known.iter().find(|(name, _)| *name == text));
        if let Some((_, value)) = word {
            found.push(*value);
            continue;
        }
        faults.enter_index(i);
        let near = item.as_str().map(|text| did_you_mean(text, names())).unwrap_or_default();
        faults.add(format!("{item} is not one of {}{near}", names().collect::<Vec<_>>().join(", ")));
        faults.leave();
    }
    (found.len() == items.len()).then_some(found)
}

fn read_scopes(value: &Value, faults: &mut Faults) -> Option<Vec<Scope>> {
    read_words(value, &Scope::ALL.map(|scope| (scope.name(), scope)), faults)
}
