//! Adapters for the reward requests that other training frameworks already send.

pub mod nemo_gym;
pub mod nemo_metrics;
mod nemo_naming;
pub mod openrlhf;
mod prompt;

use serde_json::Value;

use crate::app::rewards::scheme::scheme_named;
use plumbline_engine::checks::Criterion;
use plumbline_engine::intake::Faults;
use plumbline_engine::text::nearest;

/// Adds a fault for each member that looks like a misspelling of a missing option, which the trainer believes to have
/// set. A dataset has fields of its own, so an option of up to 8 characters allows one edit, and a longer one three. A
/// plural is another name, and so are a few words of data sets.
///
/// Where no scheme is given, neither `weights` nor a member whose name begins with "reward" may hold one.
fn add_misspelt<'a>(members: impl IntoIterator<Item = (&'a String, &'a Value)>, missing: &[&str], faults: &mut Faults) {
    let scheme = missing.iter().copied().find(|option| ["reward", "reward_scheme"].contains(option));
    let is_scheme = |value: &Value| match value {
        Value::String(name) => scheme_named(name).is_some(),
        Value::Object(members) => {
            members.contains_key("weights")
                || !members.is_empty() && members.keys().all(|name| Criterion::ALL.iter().any(|one| one.name() == name))
        }
        _ => false,
    };
    for (key, value) in members.into_iter().filter(|(key, _)| !missing.contains(&key.as_str())) {
        let allowed = |option: &str| if option.len() > 8 { 3 } else { 1 };
        let is_own = |meant: &str| ["schema", "site"].contains(&key.as_str()) || key.strip_suffix('s') == Some(meant);
        let near = nearest(key, missing.iter().copied(), allowed).filter(|meant| !is_own(meant));
        let is_other =
            key == "weights" || key.starts_with("reward") && key != "reward" && !key.starts_with("reward_sche");
        let holds_scheme = is_other && is_scheme(value);
        if let Some(meant) = near.or(scheme.filter(|_| holds_scheme)) {
            faults.add_at(key, format!("unknown; did you mean {meant}?"));
        }
    }
}
