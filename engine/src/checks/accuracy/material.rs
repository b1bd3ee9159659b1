//! Material: what the blocks are made of (`docs/rules.md#material`; paper, algorithms 1 to 3).
//!
//! Names compare case-sensitively. An empty name, of a block or in the arguments, matches nothing.

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Amount, Finding, Rule, Subject};
use crate::text::{counted, of_all};
use crate::voxel::{Cell, Structure};

/// Returns whether a block's name matches the wanted one.
fn matches(name: &str, wanted: &str, use_substring_match: bool) -> bool {
    if name.is_empty() || wanted.is_empty() {
        false
    } else if use_substring_match {
        name.contains(wanted)
    } else {
        name == wanted
    }
}

/// Counts the entries, or only those of the wanted material if one is given.
fn count(structure: &Structure, wanted: Option<&str>, use_substring_match: bool) -> usize {
    let Some(wanted) = wanted else { return structure.len() };
    let mask = structure.palette().mask(|name| matches(name, wanted, use_substring_match));
    structure.material_ids().iter().filter(|&&id| mask[id as usize]).count()
}

/// Says how many entries of the wanted material were found.
fn described(found: usize, wanted: Option<&str>, use_substring_match: bool) -> String {
    let blocks = counted(found, "block");
    match wanted {
        None => blocks,
        Some(name) if use_substring_match => format!("{blocks} whose name contains {name:?}"),
        Some(name) => format!("{blocks} of {name:?}"),
    }
}

macro_rules! count_rule {
    ($(#[$doc:meta])* $rule:ident, $bound:ident, $relation:literal $words:literal, $compare:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $rule {
            /// Number of entries to compare with.
            pub $bound: Amount,
            /// Only entries of this material count; null counts all.
            #[serde(default)]
            pub expected_material: Option<String>,
            /// Whether a block matches if its name merely contains the wanted one.
            #[serde(default)]
            pub use_substring_match: bool,
        }

        impl Rule for $rule {
            fn evaluate(&self, subject: &Subject<'_>) -> Finding {
                let wanted = self.expected_material.as_deref();
                let found = count(subject.structure, wanted, self.use_substring_match);
                let compare: fn(f64, f64) -> bool = $compare;
                let required = subject.tell(|| json!({ $relation: self.$bound }));
                let summary = subject.tell(|| {
                    let what = described(found, wanted, self.use_substring_match);
                    format!("{what}; required {} {}", $words, self.$bound)
                });
                Finding::binary(compare(found as f64, self.$bound.0), found, required, summary)
            }
        }
    };
}

count_rule!(
    /// Check that the number of entries equals a count.
    BlockCountEqualTo, expected_count, "==" "exactly", |found, bound| found == bound
);
count_rule!(
    /// Check that the number of entries is larger than a count.
    BlockCountLargerThan, cnt, ">" "more than", |found, bound| found > bound
);
count_rule!(
    /// Check that the number of entries is at least a count.
    BlockCountAtLeast, min_count, ">=" "at least", |found, bound| found >= bound
);
count_rule!(
    /// Check that the number of entries is at most a count.
    BlockCountAtMost, max_count, "<=" "at most", |found, bound| found <= bound
);

/// Check that every entry is of one material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AllMaterialEqualTo {
    /// The wanted material.
    pub expected_material: String,
    /// Whether a block matches if its name merely contains the wanted one.
    #[serde(default)]
    pub use_substring_match: bool,
}

impl Rule for AllMaterialEqualTo {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = json!({ "all": self.expected_material });
        ratio_finding(
            subject.structure,
            (0..subject.structure.len()).collect(),
            &self.expected_material,
            self.use_substring_match,
            Amount(1.0),
            required,
        )
    }
}

/// Compares the share of matching entries in a region with a threshold; an empty region fails.
fn ratio_finding(
    structure: &Structure,
    region: Vec<usize>,
    wanted: &str,
    use_substring_match: bool,
    threshold: Amount,
    required: serde_json::Value,
) -> Finding {
    if structure.is_empty() {
        return Finding::nothing_stands(false, required);
    }
    if region.is_empty() {
        return Finding::binary(false, json!(null), required, "no block stands in the region to check");
    }
    let mask = structure.palette().mask(|name| matches(name, wanted, use_substring_match));
    let is_match = |&i: &usize| mask[structure.material_ids()[i] as usize];
    let matching = region.iter().filter(|i| is_match(i)).count();
    let ratio = matching as f64 / region.len() as f64;
    let summary = format!("{} {wanted:?}", of_all(matching, region.len(), "block", "is", "are"));
    let mut finding = Finding::binary(ratio >= threshold.0, ratio, required, summary);
    for i in region.into_iter().filter(|i| !is_match(i)) {
        finding.add_witness(structure.cells()[i], structure.material(i));
    }
    finding
}

const fn default_height_y() -> i32 {
    2
}

const fn default_ratio_threshold() -> Amount {
    Amount(0.5)
}

/// Returns the indices of the entries at `y`.
fn entries_at(structure: &Structure, y: i32) -> Vec<usize> {
    (0..structure.len()).filter(|&i| structure.cells()[i].y == y).collect()
}

/// Returns the indices in `region` whose entries attain the greatest value of any of `keys`: all ties, each entry once.
fn extremes(structure: &Structure, region: &[usize], keys: &[fn(Cell) -> i64]) -> Vec<usize> {
    let at = |i: usize| structure.cells()[i];
    let greatest: Vec<Option<i64>> = keys.iter().map(|key| region.iter().map(|&i| key(at(i))).max()).collect();
    let attains = |i: usize| keys.iter().zip(&greatest).any(|(key, most)| Some(key(at(i))) == *most);
    region.iter().copied().filter(|&i| attains(i)).collect()
}

macro_rules! region_rule {
    ($(#[$doc:meta])* $rule:ident, $keys:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $rule {
            /// The wanted material.
            pub expected_material: String,
            /// Level (y) to check.
            #[serde(default = "default_height_y")]
            pub height_y: i32,
            /// Least share of matching entries.
            #[serde(default = "default_ratio_threshold")]
            pub ratio_threshold: Amount,
            /// Whether a block matches if its name merely contains the wanted one.
            #[serde(default)]
            pub use_substring_match: bool,
        }

        impl Rule for $rule {
            fn evaluate(&self, subject: &Subject<'_>) -> Finding {
                let level = entries_at(subject.structure, self.height_y);
                let region = extremes(subject.structure, &level, $keys);
                let required = json!({ ">=": self.ratio_threshold });
                ratio_finding(
                    subject.structure,
                    region,
                    &self.expected_material,
                    self.use_substring_match,
                    self.ratio_threshold,
                    required,
                )
            }
        }
    };
}

const X: fn(Cell) -> i64 = |c| i64::from(c.x);
const Z: fn(Cell) -> i64 = |c| i64::from(c.z);

region_rule!(
    /// Check of the corners of one level: the entries with the greatest x+z, x-z, -x+z or -x-z.
    CornerMaterialEqualTo, &[|c| X(c) + Z(c), |c| X(c) - Z(c), |c| Z(c) - X(c), |c| -X(c) - Z(c)]
);
region_rule!(
    /// Check of the side with the least x on one level.
    MinXMaterialEqualTo, &[|c| -X(c)]
);
region_rule!(
    /// Check of the side with the greatest x on one level.
    MaxXMaterialEqualTo, &[|c| X(c)]
);
region_rule!(
    /// Check of the side with the least z on one level.
    MinZMaterialEqualTo, &[|c| -Z(c)]
);
region_rule!(
    /// Check of the side with the greatest z on one level.
    MaxZMaterialEqualTo, &[|c| Z(c)]
);

/// Check of the entries at the greatest y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HighestBlockMaterialEqualTo {
    /// The wanted material.
    pub expected_material: String,
    /// Least share of matching entries.
    #[serde(default = "default_ratio_threshold")]
    pub ratio_threshold: Amount,
    /// Whether a block matches if its name merely contains the wanted one.
    #[serde(default)]
    pub use_substring_match: bool,
}

impl Rule for HighestBlockMaterialEqualTo {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let all: Vec<usize> = (0..subject.structure.len()).collect();
        let region = extremes(subject.structure, &all, &[|c| i64::from(c.y)]);
        let required = json!({ ">=": self.ratio_threshold });
        let (wanted, substring) = (&self.expected_material, self.use_substring_match);
        ratio_finding(subject.structure, region, wanted, substring, self.ratio_threshold, required)
    }
}
