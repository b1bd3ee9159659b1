//! Strict rule for columns: each fills the same cells on every level, from its foot to what it carries
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::{counted, range_of_counts};
use crate::voxel::Cell;
use crate::voxel::blocks::BlockSet;
use crate::voxel::planar::{Clusters, PlaneCell, Touch, extents, sorted_distinct};

/// Check of the columns between two levels.
///
/// A column fills the same cells on every level from one to the other; cells that touch, be it at an edge, are of one column.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasColumns {
    /// Lowest level (y) of the columns.
    pub from_y: i32,
    /// Highest level (y) of the columns.
    pub to_y: i32,
    /// Blocks that columns consist of; null takes any.
    #[serde(default)]
    pub of: Option<BlockSet>,
    /// Least number of columns.
    #[serde(default = "one")]
    pub min_columns: u32,
    /// Greatest number of columns; null sets no limit.
    #[serde(default)]
    pub max_columns: Option<u32>,
    /// Size of each column in plan, in either order: it fills that rectangle and no other cell; null takes any.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// Whether a block must lie on each column, one above its highest level.
    #[serde(default)]
    pub carry: bool,
    /// Whether nothing else may stand on these levels. Where no size is asked for, a column may be thicker on some levels.
    #[serde(default)]
    pub alone: bool,
    /// Whether what nothing can be built of, such as water, torches and doors, is left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub solid: bool,
}

const fn one() -> u32 {
    1
}

/// The cells of a level, by x, then z.
type Level = Vec<PlaneCell>;

impl HasColumns {
    /// Returns whether a level lies between the two.
    fn spans(&self, y: i32) -> bool {
        (self.from_y..=self.to_y).contains(&y)
    }

    /// Returns the cells that a block fills on every level.
    fn filled_throughout(&self, subject: &Subject<'_>) -> Level {
        let structure = subject.standing(self.solid);
        let own = structure.palette().mask(|name| self.of.is_none_or(|of| of.has(name)));
        let at = structure.entries().filter(|(cell, id)| self.spans(cell.y) && own[*id as usize]);
        let mut cells: Vec<(PlaneCell, i32)> = at.map(|(cell, _)| ((cell.x, cell.z), cell.y)).collect();
        cells.sort_unstable();
        cells.dedup();
        let levels = i64::from(self.to_y) - i64::from(self.from_y) + 1;
        let whole = cells.chunk_by(|a, b| a.0 == b.0).filter(|column| column.len() as i64 == levels);
        whole.map(|column| column[0].0).collect()
    }

    /// Returns a block on one of the levels that is of no column or joins two of them, and whether it joins them.
    fn other_block(&self, subject: &Subject<'_>, columns: &[PlaneCell], count: usize) -> Option<(Cell, bool)> {
        let mut cells: Vec<(i32, PlaneCell)> =
            subject.standing(self.solid).cells().iter().map(|c| (c.y, (c.x, c.z))).collect();
        cells.retain(|(y, _)| self.spans(*y));
        cells.sort_unstable();
        let is_of_column = |cell: &PlaneCell| columns.binary_search(cell).is_ok();
        cells.chunk_by(|a, b| a.0 == b.0).find_map(|level| {
            let plan = sorted_distinct(level.iter().map(|(_, cell)| *cell).collect());
            let stray = if self.size.is_some() {
                plan.iter().copied().find(|cell| !is_of_column(cell)).map(|cell| (cell, false))
            } else {
                apart_from_columns(&plan, count, &is_of_column)
            };
            stray.map(|((x, z), joins)| (Cell::new(x, level[0].0, z), joins))
        })
    }
}

/// Returns the first cell of a part of a level that holds no column, or one beside the columns of a level in which two of
/// them meet, and whether it is of the second kind.
fn apart_from_columns(
    plan: &[PlaneCell],
    columns: usize,
    is_of_column: &impl Fn(&PlaneCell) -> bool,
) -> Option<(PlaneCell, bool)> {
    let parts = Clusters::of(plan, Touch::SidesAndCorners);
    let mut holds_column = vec![false; parts.count];
    for (cell, label) in plan.iter().zip(&parts.label) {
        holds_column[*label as usize] |= is_of_column(cell);
    }
    let bare = parts.label.iter().position(|label| !holds_column[*label as usize]);
    // Every part holds a column, so fewer parts than columns mean that two of them meet.
    let beside = |cell: &PlaneCell| !is_of_column(cell);
    let meeting = || (parts.count < columns).then(|| plan.iter().position(beside)).flatten();
    bare.map(|at| (plan[at], false)).or_else(|| meeting().map(|at| (plan[at], true)))
}

impl Rule for HasColumns {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            json!({ "columns": { ">=": self.min_columns, "<=": self.max_columns }, "from_y": self.from_y, "to_y": self.to_y,
                    "size": self.size, "carry": self.carry, "alone": self.alone })
        });
        if subject.structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let cells = self.filled_throughout(subject);
        let columns = Clusters::of(&cells, Touch::SidesAndCorners);
        let mut sizes = vec![0_u64; columns.count];
        let mut carries = vec![!self.carry; columns.count];
        for ((x, z), label) in cells.iter().zip(&columns.label) {
            sizes[*label as usize] += 1;
            let above = self.to_y.checked_add(1).map(|y| Cell::new(*x, y, *z));
            carries[*label as usize] |=
                self.carry && above.is_some_and(|above| subject.standing(self.solid).contains(above));
        }
        let is_of_size = |[x, z]: [u32; 2], filled: u64| {
            self.size
                .is_none_or(|[a, b]| ([x, z] == [a, b] || [x, z] == [b, a]) && filled == u64::from(x) * u64::from(z))
        };
        let shaped: Vec<bool> =
            extents(&cells, &columns).into_iter().zip(sizes).map(|(own, n)| is_of_size(own, n)).collect();
        let fit: Vec<bool> = shaped.iter().zip(&carries).map(|(shaped, carries)| *shaped && *carries).collect();
        let count = fit.iter().filter(|fits| **fits).count();
        let misfits = columns.count - count;
        let is_within =
            count >= self.min_columns as usize && self.max_columns.is_none_or(|most| count <= most as usize);
        let other = if self.alone { self.other_block(subject, &cells, columns.count) } else { None };
        let holds = is_within && misfits == 0 && other.is_none();
        let summary = subject.tell(|| {
            let wanted = range_of_counts(self.min_columns, self.max_columns);
            let wanted = wanted.map(|range| format!("; required columns: {range}")).unwrap_or_default();
            let found = format!("{} from y = {} to y = {}", counted(count, "column"), self.from_y, self.to_y);
            let thick = shaped.iter().filter(|fits| !**fits).count();
            let bare = carries.iter().filter(|carries| !**carries).count();
            let faults = [
                (thick > 0).then(|| format!("{} of another size", counted(thick, "column"))),
                (bare > 0).then(|| format!("{} without a block on top", counted(bare, "column"))),
                other.map(|(cell, joins)| {
                    let what = if joins { "columns meet" } else { "another block stands there" };
                    format!("{what} at {:?}", <[i32; 3]>::from(cell))
                }),
            ];
            let faults: Vec<String> = faults.into_iter().flatten().collect();
            let faults = if faults.is_empty() { String::new() } else { format!(", {}", faults.join(", ")) };
            format!("{found}{faults}{wanted}")
        });
        let measured = subject.tell(|| json!({ "columns": count, "others": misfits, "alone": other.is_none() }));
        let finding = Finding::binary(holds, measured, required, summary);
        if holds {
            return finding;
        }
        let feet = subject.tell(|| columns.representatives(&cells)).into_iter();
        finding
            .with_witnesses(
                other.map(|(cell, _)| cell),
                other.map_or("", |(_, joins)| if joins { "joins columns" } else { "no column" }),
            )
            .with_witnesses(feet.map(|(x, z)| Cell::new(x, self.from_y, z)), "foot of a column")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::Structure;

    fn found(check: &serde_json::Value, boxes: &[([i32; 3], [i32; 3])], material: &str) -> (bool, String) {
        let cells = boxes.iter().flat_map(|(a, b)| {
            (a[0]..=b[0])
                .flat_map(move |x| (a[1]..=b[1]).flat_map(move |y| (a[2]..=b[2]).map(move |z| Cell::new(x, y, z))))
        });
        let structure = Structure::from_named(cells.map(|cell| (cell, material)));
        let rule: HasColumns = serde_json::from_value(check.clone()).unwrap();
        let finding = rule.evaluate(&Subject::unhurried(&structure));
        (finding.holds(), finding.summary)
    }

    const POSTS: [([i32; 3], [i32; 3]); 3] = [([0, 0, 0], [0, 2, 0]), ([4, 0, 4], [4, 2, 4]), ([0, 3, 0], [4, 3, 4])];

    #[test]
    fn columns_stand_alone_and_carry() {
        let strict = json!({ "from_y": 0, "to_y": 2, "min_columns": 2, "max_columns": 2, "size": [1, 1], "carry": true, "alone": true, "solid": true });
        assert_eq!(
            found(&strict, &POSTS, "stone"),
            (true, "2 columns from y = 0 to y = 2; required columns: 2".to_owned())
        );
        assert!(!found(&strict, &POSTS, "light").0, "one walks through light");
        let and = |more: ([i32; 3], [i32; 3])| [&POSTS[..], &[more]].concat();
        for (boxes, told) in [
            (POSTS[..2].to_vec(), "2 columns without a block on top"),
            (and(([2, 0, 2], [2, 2, 2])), "3 columns from"),
            (and(([2, 1, 2], [2, 1, 2])), "another block stands there at [2, 1, 2]"),
            (and(([1, 0, 0], [1, 2, 0])), "1 column of another size"),
            // A foot here, and a stub that hangs there.
            (vec![POSTS[0], ([4, 0, 4], [4, 0, 4]), ([3, 1, 2], [3, 2, 2]), POSTS[2]], "1 column from"),
        ] {
            let (holds, summary) = found(&strict, &boxes, "stone");
            assert!(!holds && summary.contains(told), "{summary}");
        }
    }

    #[test]
    fn columns_without_a_size_may_be_thicker_on_some_levels_and_may_not_meet() {
        let loose = json!({ "from_y": 0, "to_y": 2, "min_columns": 2, "max_columns": 2, "carry": true, "alone": true });
        let and = |more: ([i32; 3], [i32; 3])| [&POSTS[..], &[more]].concat();
        assert!(found(&loose, &and(([0, 2, 0], [1, 2, 1])), "stone").0, "a capital");
        let (holds, summary) = found(&loose, &and(([0, 2, 0], [4, 2, 4])), "stone");
        assert!(!holds && summary.contains("columns meet at [0, 2, 1]"), "{summary}");
        assert!(!found(&loose, &and(([2, 0, 2], [2, 0, 2])), "stone").0, "a block between them");
        let four = json!({ "from_y": 0, "to_y": 3, "min_columns": 4 });
        assert!(!found(&four, &POSTS, "stone").0);
        assert!(!found(&json!({ "from_y": 3, "to_y": 1 }), &POSTS, "stone").0, "no level lies between");
    }
}
