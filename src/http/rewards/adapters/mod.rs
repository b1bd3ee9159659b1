//! Adapters for the reward requests that other training frameworks already send.

pub mod nemo_gym;
pub mod nemo_metrics;
pub mod openrlhf;

use serde_json::{Map, Value};

use plumbline_engine::intake::Faults;
use plumbline_engine::text::nearest;

/// Adds a fault for each member that looks like a misspelling of a missing option, which the trainer believes to have
/// set. A dataset has fields of its own, so an option of up to 8 characters allows one edit, and a longer one three. A
/// plural is another name, and so are a few words of data sets.
fn add_misspelt(object: &Map<String, Value>, missing: &[&str], faults: &mut Faults) {
    for key in object.keys().filter(|key| !missing.contains(&key.as_str())) {
        let allowed = |option: &str| if option.len() > 8 { 3 } else { 1 };
        let meant = nearest(key, missing.iter().copied(), allowed);
        let is_own = |meant: &str| ["schema", "site"].contains(&key.as_str()) || key.strip_suffix('s') == Some(meant);
        if let Some(meant) = meant.filter(|meant| !is_own(meant)) {
            faults.add_at(key, format!("unknown; did you mean {meant}?"));
        }
    }
}
