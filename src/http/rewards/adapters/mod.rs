//! Adapters: the bodies that trainers of others already send for a reward.

pub mod nemo_gym;
pub mod nemo_metrics;
pub mod openrlhf;

use serde_json::{Map, Value};

use plumbline_engine::intake::Faults;

/// Names the members that look like one of these options misspelt, which was not given: what a trainer believes to have said, and has
/// not. A dataset has fields of its own; a short name must be one letter off, a long one may be three.
fn add_misspelt(object: &Map<String, Value>, missing: &[&str], faults: &mut Faults) {
    for key in object.keys().filter(|key| !missing.contains(&key.as_str())) {
        let meant = missing.iter().find(|option| {
            let allowed = if option.len() > 8 { 3 } else { 1 };
            strsim::osa_distance(&key.to_lowercase(), option) <= allowed
        });
        if let Some(meant) = meant {
            faults.add_at(key, format!("unknown; did you mean {meant}?"));
        }
    }
}
