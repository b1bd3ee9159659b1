//! Strict rule for domes: hollow, covered above, and rising to the middle from all sides.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::arch::break_of;
use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::rooms::FloorPlan;
use crate::voxel::{Bounds, Cell, Structure};

/// Check of a dome: that every row of the plan is covered, that there is head room below the cover in the middle, and that along
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
    /// Least share of the columns at the edge of the plan that blocks fill from y = 0 to their tops, from 0 to 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub min_footing: f64,
    /// Least share of the columns away from the edge of the plan that have a free cell below their cover, from 0 to 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub min_hollow: f64,
    /// Whether to judge the build as a shell. Its upper surface bulges up along both axes: no height lies a whole block or
    /// more below a chord; and the mean height of the plan is at least 35 % of the greatest. The middle is that of the plan. Cells are free from the cover down to the next block, which may be a floor. The plan may be open
    /// at its edge, for an entrance: only columns that it encloses, sides and corners closed, are uncovered, and at an end of
    /// an axis that is open the line goes on to y = -1, and so it does where it is open in between.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shell: bool,
    /// Whether what nothing can be built of, such as water, torches and doors, is left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub solid: bool,
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

/// Returns whether a column of a plan has an empty one on one of its four sides.
fn is_at_edge(tops: &BTreeMap<(i32, i32), i32>, (x, z): (i32, i32)) -> bool {
    [(x - 1, z), (x + 1, z), (x, z - 1), (x, z + 1)].iter().any(|side| !tops.contains_key(side))
}

/// Returns for each column of a build the number of free cells below its cover, down to the next block or to the ground.
fn free_below_covers(structure: &Structure) -> BTreeMap<(i32, i32), i32> {
    let mut cells: Vec<Cell> = structure.cells().iter().copied().filter(|cell| cell.y >= 0).collect();
    cells.sort_unstable_by_key(|cell| (cell.x, cell.z, std::cmp::Reverse(cell.y)));
    let columns = cells.chunk_by(|a, b| (a.x, a.z) == (b.x, b.z));
    let free = |column: &[Cell]| {
        let gap = column.windows(2).map(|two| two[0].y - two[1].y - 1).find(|free| *free > 0);
        gap.unwrap_or(column[column.len() - 1].y)
    };
    columns.map(|column| ((column[0].x, column[0].z), free(column))).collect()
}

/// Returns the columns at the edge of a plan that blocks do not fill from the ground to their tops, and the share of the
/// others.
fn footing(structure: &Structure, tops: &BTreeMap<(i32, i32), i32>) -> (f64, Vec<Cell>) {
    let (mut all, mut hanging) = (0.0, Vec::new());
    for ((x, z), top) in tops.iter().filter(|(at, _)| is_at_edge(tops, **at)) {
        all += 1.0;
        hanging.extend((0..*top).map(|y| Cell::new(*x, y, *z)).find(|cell| !structure.contains(*cell)));
    }
    let share = if all > 0.0 { (all - hanging.len() as f64) / all } else { 0.0 };
    (share, hanging)
}

/// Returns the first empty column that the plan encloses, at the height of the column before it.
fn hole_of(tops: &BTreeMap<(i32, i32), i32>) -> Option<Cell> {
    let plan = FloorPlan::of(tops.keys().copied().collect());
    let (x, z) = plan.rooms().first()?.first;
    let top = tops.range(..(x, z)).next_back().map_or(0, |(_, top)| *top);
    Some(Cell::new(x, top, z))
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

/// Least mean height of a shell's plan, as a share of its greatest height.
const LEAST_MEAN_HEIGHT: f64 = 0.35;

/// Returns the mean height (y) of the columns of a plan, as a share of the greatest.
fn mean_height(tops: &BTreeMap<(i32, i32), i32>) -> f64 {
    let most = tops.values().max().copied().unwrap_or(0);
    let mean = tops.values().map(|top| f64::from(*top)).sum::<f64>() / tops.len().max(1) as f64;
    if most > 0 { mean / f64::from(most) } else { 0.0 }
}

/// Returns the share of the columns away from the edge of a plan that have a free cell below their cover.
fn hollow_share(free: &BTreeMap<(i32, i32), i32>, tops: &BTreeMap<(i32, i32), i32>) -> f64 {
    let inner: Vec<i32> = free.iter().filter(|(at, _)| !is_at_edge(tops, **at)).map(|(_, free)| *free).collect();
    let hollow = inner.iter().filter(|free| **free > 0).count();
    if inner.is_empty() { 0.0 } else { hollow as f64 / inner.len() as f64 }
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
        if self.min_footing > 0.0 {
            required["footing"] = json!({ ">=": self.min_footing });
        }
        if self.min_hollow > 0.0 {
            required["hollow"] = json!({ ">=": self.min_hollow });
        }
        if self.shell {
            required["shell"] = json!(true);
        }
        required
    }
}

impl Rule for IsVault {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| self.required());
        let structure = subject.standing(self.solid);
        let Some(bounds) = structure.bounds() else { return Finding::nothing_stands(false, required) };
        let above = || structure.cells().iter().copied().filter(|cell| cell.y >= 0);
        let bounds = if self.shell { Bounds::of(above()).unwrap_or(bounds) } else { bounds };
        let (x, z) = (i32::midpoint(bounds.min.x, bounds.max.x), i32::midpoint(bounds.min.z, bounds.max.z));
        let mut tops: BTreeMap<(i32, i32), i32> = BTreeMap::new();
        let mut cover: Option<i32> = None;
        for cell in above() {
            let top = tops.entry((cell.x, cell.z)).or_insert(cell.y);
            *top = (*top).max(cell.y);
            if (cell.x, cell.z) == (x, z) {
                cover = Some(cover.map_or(cell.y, |low| low.min(cell.y)));
            }
        }
        let free = if self.shell || self.min_hollow > 0.0 { free_below_covers(structure) } else { BTreeMap::new() };
        let below_cover = free.get(&(x, z)).copied().filter(|_| self.shell);
        let clear = below_cover.or(cover).unwrap_or(0);
        let has_room = i64::from(clear) >= i64::from(self.min_clear);
        let line = |along_x: bool| -> Vec<i32> {
            let on_line = |at: &(i32, i32)| if along_x { at.1 == z } else { at.0 == x };
            let along = |at: &(i32, i32)| if along_x { at.0 } else { at.1 };
            let mut heights: Vec<i32> = Vec::new();
            let mut last = None;
            for (at, top) in tops.iter().filter(|(at, _)| on_line(at)) {
                // What is open within the line is a dip.
                let is_open = self.shell && last.replace(along(at)).is_some_and(|last| last + 1 < along(at));
                heights.extend(is_open.then_some(-1));
                heights.push(*top);
            }
            if !self.shell {
                return heights;
            }
            let own = || tops.keys().filter(|at| on_line(at)).map(along);
            let opens = |end: Option<i32>, of_plan: Option<i32>| (end != of_plan).then_some(-1);
            let before = opens(own().min(), tops.keys().map(along).min());
            let after = opens(own().max(), tops.keys().map(along).max());
            before.into_iter().chain(heights).chain(after).collect()
        };
        let lines = [line(true), line(false)];
        // Every row of the plan is covered from one end to the other.
        let hole = if self.shell { hole_of(&tops) } else { uncovered(&tops) };
        let is_closed = hole.is_none();
        let plan_share = covered_share(&tops);
        let gap = if self.no_gaps { gap_of(structure, &tops) } else { None };
        let falls = lines.iter().all(|line| falls_to_both_ends(line));
        let (footing, hanging) = if self.min_footing > 0.0 { footing(structure, &tops) } else { (1.0, Vec::new()) };
        let stands = footing >= self.min_footing;
        let hollow = if self.min_hollow > 0.0 { hollow_share(&free, &tops) } else { 1.0 };
        let is_hollow = hollow >= self.min_hollow;
        let is_high = !self.shell || mean_height(&tops) >= LEAST_MEAN_HEIGHT;
        let bulges = !self.shell || lines.iter().all(|line| break_of(line).is_none());
        let is_whole = is_closed && plan_share >= self.min_cover && gap.is_none();
        let holds = is_whole && has_room && falls && stands && is_hollow && is_high && bulges;
        let measured = subject.tell(|| {
            let mut measured = json!({ "clear": clear, "closed": is_closed, "cover": plan_share,
                    "gaps": self.no_gaps.then_some(gap.is_some()),
                    "falls_to_all_sides": falls, "along_x": lines[0], "along_z": lines[1] });
            if self.min_footing > 0.0 {
                measured["footing"] = json!(footing);
            }
            if self.min_hollow > 0.0 {
                measured["hollow"] = json!(hollow);
            }
            measured
        });
        let failed: Vec<&str> = [
            (is_closed, "some row of the plan is not covered from end to end"),
            (plan_share >= self.min_cover, "the plan covers too little of the rectangle around it"),
            (gap.is_none(), "a column does not reach down to its lower neighbour"),
            (stands, "too little of its edge reaches down to the ground"),
            (is_hollow, "too little of it is hollow"),
            (is_high, "it is flat but for its middle"),
            (bulges, "the upper surface does not bulge up"),
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
            .with_witnesses(hanging.into_iter().filter(|_| !stands), "does not reach the ground")
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
    fn an_umbrella_on_a_pole_is_no_vault() {
        let height = |x: i32, z: i32| 5 - (x - 3).abs().max((z - 3).abs());
        let at_edge = |cell: &Cell| [0, 6].contains(&cell.x) || [0, 6].contains(&cell.z);
        let built = |is_left_out: fn(&Cell) -> bool| {
            let plan = (0..7).flat_map(|x| (0..7).map(move |z| (x, z)));
            let cells = plan.flat_map(|(x, z)| [height(x, z) - 1, height(x, z)].map(|y| Cell::new(x, y, z)));
            let foot = (0..7).flat_map(|x| (0..7).map(move |z| Cell::new(x, 0, z))).filter(at_edge);
            let mut cells: Vec<Cell> = cells.chain(foot).filter(|cell| !is_left_out(cell)).collect();
            cells.sort_unstable();
            cells.dedup();
            let rule = IsVault {
                min_clear: 2,
                min_cover: 0.65,
                no_gaps: true,
                min_footing: 0.8,
                min_hollow: 0.5,
                shell: true,
                solid: true,
            };
            let structure = Structure::from_named(cells.into_iter().map(|cell| (cell, "stone")));
            let finding = rule.evaluate(&Subject::unhurried(&structure));
            (finding.holds(), finding.summary)
        };
        assert!(built(|_| false).0);
        assert!(built(|cell| cell.x == 0 && (2..5).contains(&cell.z) && cell.y == 0).0, "a doorway");
        let (holds, summary) = built(|cell| (cell.x == 0 || cell.z == 0) && cell.y < 1);
        assert!(!holds && summary.starts_with("too little of its edge reaches down to the ground"), "{summary}");
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
            let rule = IsVault {
                min_clear: 2,
                min_cover: 0.0,
                no_gaps: true,
                min_footing: 0.0,
                min_hollow: 0.0,
                shell: false,
                solid: false,
            };
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
