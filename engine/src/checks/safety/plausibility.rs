//! Physical plausibility: nothing floats (`docs/rules.md#physical-plausibility`; paper, algorithm "Ground
//! Connectivity").

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::of_all;
use crate::voxel::connectivity::floating_cells;

/// Check that every block is connected through shared faces to a block at y <= 0.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundConnected {
    /// Accepted for compatibility with the published evaluator, where it only requests a drawing; changes no score.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mark_visit: bool,
}

impl Rule for GroundConnected {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "floating": 0 }));
        if subject.structure.is_empty() {
            return Finding::nothing_stands(true, required);
        }
        let floating = floating_cells(subject.structure);
        let summary = subject.tell(|| of_all(floating.len(), subject.structure.len(), "block", "floats", "float"));
        Finding::binary(floating.is_empty(), floating.len(), required, summary).with_witnesses(floating, "floats")
    }
}
