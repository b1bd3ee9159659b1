//! Strict rule for domes: hollow, covered above, and rising to the middle from all sides.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::{Cell, Structure};

/// Check that every row of the plan is covered, that there is head room below the cover in the middle, and that along
/// both axes through the middle the upper surface falls to either side by at least two blocks without rising again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IsVault {
    /// Least number of free cells between the ground and the cover, in the middle.
    pub min_clear: u32,
    /// Least share of the rectangle around the plan that the plan covers, from 0 to 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub min_cover: f64,
    /// Whether of two neighbouring columns the higher one must reach down to just above the lower one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub no_gaps: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

/// Returns the first free cell through which the cover lets air pass between two neighbouring columns of different
/// heights.
fn gap_of(structure: &Structure, tops: &BTreeMap<(i32, i32), i32>) -> Option<Cell> {
    tops.iter().find_map(|((x, z), top)| {
        let sides = [(x - 1, *z), (x + 1, *z), (*x, z - 1), (*x, z + 1)];
        let lower = sides.iter().filter_map(|side| tops.get(side)).min()?;
        (lower + 1..=*top).map(|y| Cell::new(*x, y, *z)).find(|cell| !structure.contains(*cell))
    })
}

/// Returns the first column of the plan's rows that has no block although columns to both sides do, at the height of the
/// column before it.
fn uncovered(tops: &BTreeMap<(i32, i32), i32>) -> Option<Cell> {
    let mut rows: BTreeMap<i32, (i32, i32)> = BTreeMap::new();
    tops.iter().find_map(|((x, z), top)| {
        // Columns come by x, so those of a row do.
        let (before, y) = rows.insert(*z, (*x, *top))?;
        (before + 1 < *x).then(|| Cell::new(before + 1, y, *z))
    })
}

/// Returns the share of the rectangle around a plan that the plan covers.
fn covered_share(tops: &BTreeMap<(i32, i32), i32>) -> f64 {
    let span = |along: fn(&(i32, i32)) -> i32| {
        let all = || tops.keys().map(along);
        all().max().zip(all().min()).map_or(0, |(most, least)| most.abs_diff(least) + 1)
    };
    let area = f64::from(span(|at| at.0)) * f64::from(span(|at| at.1));
    if area > 0.0 { tops.len() as f64 / area } else { 0.0 }
}

impl IsVault {
    fn required(&self) -> Value {
        let mut required = json!({ "clear": { ">=": self.min_clear }, "closed": true, "falls_to_all_sides": true });
        if self.min_cover > 0.0 {
            required["cover"] = json!({ ">=": self.min_cover });
        }
        if self.no_gaps {
            required["gaps"] = json!(false);
        }
        required
    }
}

impl Rule for IsVault {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| self.required());
        let structure = subject.structure;
        let Some(bounds) = structure.bounds() else { return Finding::nothing_stands(false, required) };
        let (x, z) = (i32::midpoint(bounds.min.x, bounds.max.x), i32::midpoint(bounds.min.z, bounds.max.z));
        let mut tops: BTreeMap<(i32, i32), i32> = BTreeMap::new();
        let mut cover: Option<i32> = None;
        for cell in structure.cells().iter().filter(|cell| cell.y >= 0) {
            let top = tops.entry((cell.x, cell.z)).or_insert(cell.y);
            *top = (*top).max(cell.y);
            if (cell.x, cell.z) == (x, z) {
                cover = Some(cover.map_or(cell.y, |low| low.min(cell.y)));
            }
        }
        let clear = cover.unwrap_or(0);
        let has_room = i64::from(clear) >= i64::from(self.min_clear);
        let line = |along_x: bool| -> Vec<i32> {
            let on_line = |at: &(i32, i32)| if along_x { at.1 == z } else { at.0 == x };
            tops.iter().filter(|(at, _)| on_line(at)).map(|(_, top)| *top).collect()
        };
        let lines = [line(true), line(false)];
        // Every row of the plan is covered from one end to the other.
        let hole = uncovered(&tops);
        let is_closed = hole.is_none();
        let plan_share = covered_share(&tops);
        let gap = if self.no_gaps { gap_of(structure, &tops) } else { None };
        let falls = lines.iter().all(|line| falls_to_both_ends(line));
        let holds = is_closed && plan_share >= self.min_cover && gap.is_none() && has_room && falls;
        let measured = subject.tell(|| {
            json!({ "clear": clear, "closed": is_closed, "cover": plan_share, "gaps": self.no_gaps.then_some(gap.is_some()),
                    "falls_to_all_sides": falls, "along_x": lines[0], "along_z": lines[1] })
        });
        let failed: Vec<&str> = [
            (is_closed, "some row of the plan is not covered from end to end"),
            (plan_share >= self.min_cover, "the plan covers too little of the rectangle around it"),
            (gap.is_none(), "a column does not reach down to its lower neighbour"),
            (has_room, "too few cells are free over the middle"),
            (falls, "the upper surface does not fall by two to every side, or dips"),
        ]
        .into_iter()
        .filter(|(is_met, _)| !is_met)
        .map(|(_, told)| told)
        .collect();
        let summary = if holds {
            format!("{} under the cover", counted(clear, "free cell"))
        } else {
            format!(
                "{}: {} under the cover; upper surface {:?} along x, {:?} along z",
                failed.join(", and "),
                counted(clear, "free cell"),
                lines[0],
                lines[1]
            )
        };
        Finding::binary(holds, measured, required, summary)
            .with_witnesses(cover.map(|y| Cell::new(x, y, z)), "cover over the middle")
            .with_witnesses(hole, "not covered")
            .with_witnesses(gap, "gap")
    }
}

/// Returns whether heights rise to a maximum and fall again, by at least two on either side.
fn falls_to_both_ends(heights: &[i32]) -> bool {
    let Some(top) = heights.iter().max() else { return false };
    let Some(peak) = heights.iter().position(|height| height == top) else { return false };
    let (up, down) = heights.split_at(peak);
    let ends = [up.first(), down.last()];
    up.is_sorted() && down.is_sorted_by(|a, b| a >= b) && ends.iter().all(|end| end.is_some_and(|end| end + 2 <= *top))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_falls() {
        assert!(falls_to_both_ends(&[0, 2, 3, 3, 2, 0]));
        assert!(!falls_to_both_ends(&[3, 3, 3]), "flat");
        assert!(!falls_to_both_ends(&[0, 1, 2]), "falls on one side only");
        assert!(!falls_to_both_ends(&[0, 3, 1, 3, 0]), "dips");
        assert!(!falls_to_both_ends(&[]));
    }

    #[test]
    fn a_hole_and_a_gap_say_where() {
        // A pyramid of columns: the cover of each ring lies one higher, and each column reaches down to the next ring.
        let height = |x: i32, z: i32| 5 - (x - 3).abs().max((z - 3).abs());
        let columns = || (0..7).flat_map(|x| (0..7).map(move |z| (x, z)));
        let dome = |is_left_out: fn(Cell) -> bool| {
            let cells = columns().flat_map(|(x, z)| [height(x, z) - 1, height(x, z)].map(|y| Cell::new(x, y, z)));
            Structure::from_named(cells.filter(|cell| !is_left_out(*cell)).map(|cell| (cell, "stone")))
        };
        let found = |build: &Structure| {
            let rule = IsVault { min_clear: 2, min_cover: 0.0, no_gaps: true };
            let finding = rule.evaluate(&Subject::unhurried(build));
            let shown = finding.witnesses.iter().map(|witness| (<[i32; 3]>::from(witness.cell), witness.why.clone()));
            (finding.holds(), shown.skip(1).collect::<Vec<_>>())
        };
        assert_eq!(found(&dome(|_| false)), (true, vec![]));
        let open = found(&dome(|cell| (cell.x, cell.z) == (1, 5)));
        assert_eq!(open, (false, vec![([1, 2, 5], "not covered".to_owned())]));
        let thin = found(&dome(|cell| <[i32; 3]>::from(cell) == [1, 2, 1]));
        assert!(thin.0, "{thin:?}: the column reaches its neighbour all the same");
        let high = Cell::new(3, 9, 3);
        let mut cells: Vec<Cell> = dome(|_| false).cells().to_vec();
        cells.push(high);
        let gap = found(&Structure::from_named(cells.into_iter().map(|cell| (cell, "stone"))));
        assert_eq!(gap, (false, vec![([3, 6, 3], "gap".to_owned())]));
    }
}
