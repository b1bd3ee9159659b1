//! Findings of checks: the score, the measured and the required value, and the cells that explain them.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::safety::figures::StressFigures;
use super::sample::MAX_WITNESSES;
use crate::voxel::Cell;

/// Greatest number of items kept of a list in `measured` or `required`.
pub const MAX_ITEMS: usize = 64;
/// Greatest number of characters kept of a witness's `why`.
const MAX_WHY_CHARS: usize = 100;
/// Greatest number of characters kept of any other text in a finding.
pub const MAX_CHARS: usize = 1_000;

/// Cell that shows why a check scored as it did.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Witness {
    /// The cell, as `[x, y, z]`.
    #[schema(value_type = [i32; 3])]
    pub cell: Cell,
    /// Reason to show the cell: its material name or a short description ("floats", "leaks").
    pub why: String,
}

/// Score of one check, with evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Finding {
    /// Score in [0, 1]; binary checks give 0 or 1.
    #[schema(minimum = 0, maximum = 1)]
    pub score: f64,
    /// Value measured in the structure, such as a number, a list or a word, or null.
    pub measured: Value,
    /// Value that the check requires, as `{relation: value}`, such as `{"==": 49}`.
    pub required: Value,
    /// What was measured and what is required, as `measured; required …`. Pages show the part before `; required` alone.
    pub summary: String,
    /// Cells that show why the check scored as it did; at most [`MAX_WITNESSES`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub witnesses: Vec<Witness>,
    /// Total number of such cells, listed or not.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub witness_total: u64,
    /// Whether the check held only because there was nothing to check.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub vacuous: bool,
    /// Reasons to read the score with care, other than being vacuous.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cautions: Vec<String>,
    /// Whether lists in `measured` and `required` were cut to their first items, or texts to their first characters,
    /// because the build is large.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shortened: bool,
    /// Figures of both stress methods; present only for the stress check that runs both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stress: Option<Box<StressFigures>>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(n: &u64) -> bool {
    *n == 0
}

impl Finding {
    /// Returns a finding with a score of 1 if the check holds, otherwise 0.
    #[must_use]
    pub fn binary(holds: bool, measured: impl Into<Value>, required: Value, summary: impl Into<String>) -> Self {
        Self::graded(if holds { 1.0 } else { 0.0 }, measured, required, summary)
    }

    /// Returns a finding with the score clamped to [0, 1]; NaN counts as 0.
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

    /// Returns the finding for a structure without blocks; it is vacuous if the check holds.
    #[must_use]
    pub fn nothing_stands(holds: bool, required: Value) -> Self {
        let mut finding = Self::binary(holds, Value::Null, required, "no blocks stand");
        finding.vacuous = holds;
        finding
    }

    /// Cuts lists and texts to a length that a reader needs, however large the build is.
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

    /// Returns the heap memory that the finding takes, in bytes, in addition to its own size.
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

    /// Returns whether the check holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        holds(self.score)
    }

    /// Adds the cells as witnesses.
    #[must_use]
    pub fn with_witnesses(mut self, cells: impl IntoIterator<Item = Cell>, why: &str) -> Self {
        for cell in cells {
            self.add_witness(cell, why);
        }
        self
    }

    /// Adds a cell as a witness; beyond [`MAX_WITNESSES`] it is only counted.
    pub fn add_witness(&mut self, cell: Cell, why: &str) {
        self.witness_total += 1;
        if self.witnesses.len() < MAX_WITNESSES {
            self.witnesses.push(Witness { cell, why: why.to_owned() });
        }
    }

    /// Sets whether the check held only because there was nothing to check.
    #[must_use]
    pub const fn vacuous_if(mut self, vacuous: bool) -> Self {
        self.vacuous = vacuous;
        self
    }
}

/// Returns whether a check with this score holds, which takes a score of 1 (`docs/rules.md#scores`).
#[must_use]
pub fn holds(score: f64) -> bool {
    score >= 1.0
}

/// Upper bound on the heap memory of a stress check's figures, in bytes.
const STRESS_BYTES: usize = 2_048;
/// Memory that an object member takes in addition to its name and value, in bytes: its share of a tree node.
const MEMBER_BYTES: usize = 64;

/// Returns the heap memory that a value takes, in bytes, in addition to its own size.
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

/// Cuts long lists and texts, and returns whether anything was cut.
fn cut(value: &mut Value) -> bool {
    match value {
        Value::Null | Value::Bool(_) | Value::Number(_) => false,
        Value::String(text) => cut_text(text),
        Value::Array(items) => {
            let is_long = items.len() > MAX_ITEMS;
            if is_long {
                // Copies the first items instead of truncating the list in place: the remains of thousands of long
                // lists would keep an allocator from reusing their memory.
                *items = items.drain(..).take(MAX_ITEMS).collect();
            }
            items.iter_mut().fold(is_long, |is_cut, item| cut(item) | is_cut)
        }
        Value::Object(members) => members.values_mut().fold(false, |is_cut, member| cut(member) | is_cut),
    }
}

fn cut_text(text: &mut String) -> bool {
    cut_text_to(text, MAX_CHARS)
}

fn cut_text_to(text: &mut String, most: usize) -> bool {
    // A character has at least one byte.
    if text.len() <= most {
        return false;
    }
    let Some((end, _)) = text.char_indices().nth(most) else { return false };
    *text = format!("{}…", &text[..end]);
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
