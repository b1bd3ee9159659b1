//! What a check found: its score, what was measured against what was required, and the cells that show it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::safety::figures::StressFigures;
use crate::voxel::Cell;

/// Witness cells kept at most; all are counted.
pub const MAX_WITNESSES: usize = 20;

/// Items of a list in `measured` kept at most.
pub const MAX_ITEMS: usize = 64;
/// Characters of what a witness shows kept at most.
const MAX_WHY_CHARS: usize = 100;
/// Characters of a text in a finding kept at most.
pub const MAX_CHARS: usize = 1_000;

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
    /// Lists in `measured` and `required` are cut to their first items, or texts to their first characters: the build is large.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shortened: bool,
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
            shortened: false,
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

    /// With lists and texts no longer than a reader needs, however large the build is.
    #[must_use]
    pub fn bounded(mut self) -> Self {
        let mut is_cut = cut_text(&mut self.summary);
        is_cut |= cut(&mut self.measured) | cut(&mut self.required);
        for text in &mut self.cautions {
            is_cut |= cut_text(text);
        }
        for witness in &mut self.witnesses {
            is_cut |= cut_text_to(&mut witness.why, MAX_WHY_CHARS);
        }
        self.shortened |= is_cut;
        self
    }

    /// Bytes of memory that it takes, beside its own size.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        let texts = self.cautions.iter().chain(self.witnesses.iter().map(|witness| &witness.why));
        value_bytes(&self.measured)
            + value_bytes(&self.required)
            + self.summary.capacity()
            + self.witnesses.capacity() * size_of::<Witness>()
            + self.cautions.capacity() * size_of::<String>()
            + texts.map(String::capacity).sum::<usize>()
            + self.stress.as_ref().map_or(0, |_| STRESS_BYTES)
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

/// What the figures of a stress check take at most.
const STRESS_BYTES: usize = 2_048;
/// What a member of an object takes beside its name and value: its part of a tree's node.
const MEMBER_BYTES: usize = 64;

/// Bytes of memory that a value takes, beside its own size.
#[must_use]
pub fn value_bytes(value: &Value) -> usize {
    match value {
        Value::Null | Value::Bool(_) | Value::Number(_) => 0,
        Value::String(text) => text.capacity(),
        Value::Array(items) => items.capacity() * size_of::<Value>() + items.iter().map(value_bytes).sum::<usize>(),
        Value::Object(members) => members
            .iter()
            .map(|(name, value)| MEMBER_BYTES + name.capacity() + size_of::<Value>() + value_bytes(value))
            .sum(),
    }
}

/// Cuts lists and texts; says whether anything was cut.
fn cut(value: &mut Value) -> bool {
    match value {
        Value::Null | Value::Bool(_) | Value::Number(_) => false,
        Value::String(text) => cut_text(text),
        Value::Array(items) => {
            let is_long = items.len() > MAX_ITEMS;
            items.truncate(MAX_ITEMS);
            items.shrink_to_fit();
            items.iter_mut().fold(is_long, |is_cut, item| cut(item) | is_cut)
        }
        Value::Object(members) => members.values_mut().fold(false, |is_cut, member| cut(member) | is_cut),
    }
}

fn cut_text(text: &mut String) -> bool {
    cut_text_to(text, MAX_CHARS)
}

fn cut_text_to(text: &mut String, most: usize) -> bool {
    let Some((end, _)) = text.char_indices().nth(most) else { return false };
    text.truncate(end);
    text.push('…');
    text.shrink_to_fit();
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_a_large_build_shows_is_cut_and_says_so() {
        let measured = json!({ "along_x": vec![1; 5_000], "word": "ä".repeat(5_000), "few": [1, 2] });
        let finding = Finding::binary(false, measured, json!(null), "x".repeat(9_000)).bounded();
        assert!(finding.shortened);
        assert_eq!(finding.measured["along_x"].as_array().map(Vec::len), Some(MAX_ITEMS));
        assert_eq!(finding.measured["few"], json!([1, 2]));
        assert_eq!(finding.summary.chars().count(), MAX_CHARS + 1);
        assert!(finding.heap_bytes() < 16 << 10, "{}", finding.heap_bytes());
        let small = Finding::binary(true, json!([1, 2]), json!(null), "fine");
        assert_eq!(small.clone().bounded(), small);
    }
}
