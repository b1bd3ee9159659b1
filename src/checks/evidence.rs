//! What a check found: its score, what was measured against what was required, and the cells that show it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::safety::figures::StressFigures;
use crate::voxel::Cell;

/// Witness cells kept at most; all are counted.
pub const MAX_WITNESSES: usize = 20;

/// A cell that shows why a check scored as it did.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Witness {
    /// The cell, as `[x, y, z]`.
    #[schema(value_type = [i32; 3])]
    pub cell: Cell,
    /// What about it: a material name, or what it does ("floats", "leaks").
    pub why: String,
}

/// Score of one check, with evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Finding {
    /// In [0, 1]; binary checks give 0 or 1.
    #[schema(minimum = 0, maximum = 1)]
    pub score: f64,
    /// What the structure has: a number, a list, a word or null.
    pub measured: Value,
    /// What the check wants, as `{relation: value}`, such as `{"==": 49}`.
    pub required: Value,
    /// Both in one sentence.
    pub summary: String,
    /// Cells that show it; at most [`MAX_WITNESSES`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub witnesses: Vec<Witness>,
    /// How many such cells there are.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub witness_total: u64,
    /// The check held only because there was nothing to check.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub vacuous: bool,
    /// Why the score must be read with care, beside being vacuous.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cautions: Vec<String>,
    /// Of a stress check: both methods' figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stress: Option<Box<StressFigures>>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(n: &u64) -> bool {
    *n == 0
}

impl Finding {
    /// A binary result.
    #[must_use]
    pub fn binary(holds: bool, measured: impl Into<Value>, required: Value, summary: impl Into<String>) -> Self {
        Self::graded(if holds { 1.0 } else { 0.0 }, measured, required, summary)
    }

    /// A graded result; the score is clamped to [0, 1], and one that is not a number counts as 0.
    #[must_use]
    pub fn graded(score: f64, measured: impl Into<Value>, required: Value, summary: impl Into<String>) -> Self {
        let score = if score.is_nan() { 0.0 } else { score.clamp(0.0, 1.0) };
        Self {
            score,
            measured: measured.into(),
            required,
            summary: summary.into(),
            witnesses: Vec::new(),
            witness_total: 0,
            vacuous: false,
            cautions: Vec::new(),
            stress: None,
        }
    }

    /// The result for a structure without blocks.
    #[must_use]
    pub fn nothing_stands(holds: bool, required: Value) -> Self {
        let mut finding = Self::binary(holds, Value::Null, required, "no blocks stand");
        finding.vacuous = holds;
        finding
    }

    /// Whether the check counts as held: a score of 1 (SPEC 5).
    #[must_use]
    pub fn holds(&self) -> bool {
        self.score >= 1.0
    }

    /// With the cells that show it.
    #[must_use]
    pub fn with_witnesses(mut self, cells: impl IntoIterator<Item = Cell>, why: &str) -> Self {
        for cell in cells {
            self.add_witness(cell, why);
        }
        self
    }

    /// With one more cell that shows it.
    pub fn add_witness(&mut self, cell: Cell, why: &str) {
        self.witness_total += 1;
        if self.witnesses.len() < MAX_WITNESSES {
            self.witnesses.push(Witness { cell, why: why.to_owned() });
        }
    }

    /// Marked as held only for want of anything to check.
    #[must_use]
    pub const fn vacuous_if(mut self, vacuous: bool) -> Self {
        self.vacuous = vacuous;
        self
    }
}
