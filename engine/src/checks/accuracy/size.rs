//! Size: extents and heights of the bounding box (`docs/rules.md#size`; paper, algorithms "Bounding-Box Size" and
//! "Vertical and Minimum-Size").

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Amount, Finding, Rule, Subject};
use crate::voxel::{Bounds, Cell};

/// Check that the plan size, in either order of x and z, and the height equal the given ones, in blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Equal {
    /// Blocks spanned along x and z, in any order.
    pub xz: [Amount; 2],
    /// Blocks spanned along y; null leaves the height free.
    #[serde(default)]
    pub y: Option<Amount>,
}

/// Check that the plan size, in either order of x and z, and the height are at most the given ones, in blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AtMost {
    /// Blocks spanned along x and z, in any order.
    pub xz: [Amount; 2],
    /// Blocks spanned along y; null leaves the height free.
    #[serde(default)]
    pub y: Option<Amount>,
}

/// Shows two opposite corners of the bounding box, or the only block.
fn with_corners(finding: Finding, bounds: &Bounds) -> Finding {
    let other = Some(bounds.max).filter(|max| *max != bounds.min);
    finding.with_witnesses([bounds.min].into_iter().chain(other), "corner of the bounding box")
}

fn size_finding(
    subject: &Subject<'_>,
    xz: [Amount; 2],
    y: Option<Amount>,
    relation: &str,
    compare: fn(f64, f64) -> bool,
) -> Finding {
    let required = subject.tell(|| json!({ relation: { "xz": xz, "y": y } }));
    let Some(bounds) = subject.structure.bounds() else {
        return Finding::nothing_stands(false, required);
    };
    let [dx, dy, dz] = bounds.extent().map(|d| d as f64);
    let mut found = [dx, dz];
    let mut wanted = xz.map(|blocks| blocks.0 - 1.0);
    found.sort_by(f64::total_cmp);
    wanted.sort_by(f64::total_cmp);
    let holds =
        compare(found[0], wanted[0]) && compare(found[1], wanted[1]) && y.is_none_or(|y| compare(dy, y.0 - 1.0));
    let spans = [dx + 1.0, dy + 1.0, dz + 1.0];
    let summary = subject.tell(|| {
        let bound = if relation == "==" { "exactly" } else { "at most" };
        let height = y.map_or_else(|| "any height".to_owned(), |y| format!("{bound} {y} in height"));
        format!(
            "spans {} x {} in plan and {} in height; required {bound} {} x {} in plan, {height}",
            spans[0], spans[2], spans[1], xz[0], xz[1]
        )
    });
    let measured = subject.tell(|| json!({ "x": spans[0], "y": spans[1], "z": spans[2] }));
    let finding = Finding::binary(holds, measured, required, summary);
    if holds { finding } else { with_corners(finding, &bounds) }
}

impl Rule for Equal {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        size_finding(subject, self.xz, self.y, "==", |found, wanted| found == wanted)
    }
}

impl Rule for AtMost {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        size_finding(subject, self.xz, self.y, "<=", |found, wanted| found <= wanted)
    }
}

/// Check that the least y equals a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MinYEqual {
    /// Required y of the lowest block.
    pub expected_y: Amount,
}

/// Check that the least y is at or below a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MinYAtMost {
    /// Greatest allowed y of the lowest block.
    pub max_y: Amount,
}

/// Check that the greatest y is at or above a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaxYAtLeast {
    /// Least allowed y of the highest block.
    pub min_y: Amount,
}

fn height_finding(
    subject: &Subject<'_>,
    pick: fn(&Bounds) -> i32,
    what: &str,
    relation: &str,
    bound: Amount,
    compare: fn(f64, f64) -> bool,
) -> Finding {
    let required = subject.tell(|| json!({ relation: bound }));
    let Some(bounds) = subject.structure.bounds() else {
        return Finding::nothing_stands(false, required);
    };
    let y = pick(&bounds);
    let holds = compare(f64::from(y), bound.0);
    let summary = subject.tell(|| {
        let side = match relation {
            ">=" => " or higher",
            "<=" => " or lower",
            _ => "",
        };
        format!("the {what} block is at y = {y}; required {bound}{side}")
    });
    let finding = Finding::binary(holds, y, required, summary);
    if holds {
        return finding;
    }
    let at_y: Vec<Cell> = subject.structure.cells().iter().copied().filter(|c| c.y == y).collect();
    finding.with_witnesses(at_y, what)
}

impl Rule for MinYEqual {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        height_finding(subject, |b| b.min.y, "lowest", "==", self.expected_y, |y, bound| y == bound)
    }
}

impl Rule for MinYAtMost {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        height_finding(subject, |b| b.min.y, "lowest", "<=", self.max_y, |y, bound| y <= bound)
    }
}

impl Rule for MaxYAtLeast {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        height_finding(subject, |b| b.max.y, "highest", ">=", self.min_y, |y, bound| y >= bound)
    }
}

/// Check that the build measures at least a size along every axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AllDimensionsAtLeast {
    /// Least size along each axis, in blocks.
    pub min_size: Amount,
}

impl Rule for AllDimensionsAtLeast {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_size }));
        let Some(bounds) = subject.structure.bounds() else {
            return Finding::nothing_stands(false, required);
        };
        let [x, y, z] = bounds.extent().map(|d| d + 1);
        let holds = [x, y, z].iter().all(|&blocks| (blocks - 1) as f64 >= self.min_size.0 - 1.0);
        let measured: Value = subject.tell(|| json!({ "x": x, "y": y, "z": z }));
        let summary =
            subject.tell(|| format!("spans {x} x {y} x {z}; required at least {} on each axis", self.min_size));
        let finding = Finding::binary(holds, measured, required, summary);
        if holds { finding } else { with_corners(finding, &bounds) }
    }
}
