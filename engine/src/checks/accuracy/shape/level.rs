//! Strict rule for what stands at one level: how many blocks, in how many parts, and how far they reach
//! (`docs/rules.md#strict-rules`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::{counted, range_of_counts};
use crate::voxel::Cell;
use crate::voxel::blocks::BlockSet;
use crate::voxel::planar::{Clusters, PlaneCell, Touch, extents, sorted_distinct};

/// Check of the blocks of one level: their number, the number of separate parts, and the extent of the widest part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LevelHas {
    /// Level (y) to check.
    pub y: i32,
    /// Blocks that count; null counts all.
    #[serde(default)]
    pub of: Option<BlockSet>,
    /// Least number of blocks.
    #[serde(default)]
    pub min_blocks: u32,
    /// Greatest number of blocks; null sets no limit.
    #[serde(default)]
    pub max_blocks: Option<u32>,
    /// Least number of parts that do not touch, not even at edges.
    #[serde(default)]
    pub min_parts: u32,
    /// Greatest number of such parts; null sets no limit.
    #[serde(default)]
    pub max_parts: Option<u32>,
    /// Sizes along x and z, in either order, that one part reaches; null asks for none.
    #[serde(default)]
    pub min_size: Option<[u32; 2]>,
    /// Least number of blocks of each part.
    #[serde(default, skip_serializing_if = "super::is_zero")]
    pub min_part_blocks: u32,
    /// Sizes along x and z, in either order, of a rectangle that blocks fill; null asks for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_size: Option<[u32; 2]>,
    /// Whether what nothing can be built of, such as water, torches and doors, is left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub solid: bool,
}

impl LevelHas {
    /// Returns the bounds in words, or `None` if there are none.
    fn wanted(&self) -> Option<String> {
        let blocks = range_of_counts(self.min_blocks, self.max_blocks).map(|range| format!("blocks: {range}"));
        let parts = range_of_counts(self.min_parts, self.max_parts).map(|range| format!("parts: {range}"));
        let size = self.min_size.map(|[a, b]| format!("a part of at least {a} by {b}"));
        let each = (self.min_part_blocks > 0).then(|| format!("each part: at least {}", self.min_part_blocks));
        let full = self.full_size.map(|[a, b]| format!("a full rectangle of {a} by {b}"));
        let all: Vec<String> = [blocks, parts, each, size, full].into_iter().flatten().collect();
        (!all.is_empty()).then(|| all.join(", "))
    }

    fn cells(&self, subject: &Subject<'_>) -> Vec<PlaneCell> {
        let structure = subject.standing(self.solid);
        let own = structure.palette().mask(|name| self.of.is_none_or(|of| of.has(name)));
        let at = structure.entries().filter(|(cell, id)| cell.y == self.y && own[*id as usize]);
        sorted_distinct(at.map(|(cell, _)| (cell.x, cell.z)).collect())
    }
}

/// Returns whether `cells`, by x and then z, fill a rectangle of `a` cells along x by `b` along z.
fn has_rectangle(cells: &[PlaneCell], a: u32, b: u32) -> bool {
    let (a, b) = (a.max(1), b.max(1));
    if u64::from(a) * u64::from(b) > cells.len() as u64 {
        return false;
    }
    // For each cell with enough others behind it along z, how many such cells precede it along x, itself included.
    let mut before: BTreeMap<i32, (i32, u32)> = BTreeMap::new();
    let mut run = 0;
    let places = (0..cells.len()).rev().map(|i| {
        let (x, z) = cells[i];
        let goes_on = cells.get(i + 1).is_some_and(|next| x == next.0 && z.checked_add(1) == Some(next.1));
        run = if goes_on { run + 1 } else { 1 };
        (x, z, run)
    });
    for (x, z, _) in places.filter(|(.., run)| *run >= b) {
        let count =
            before.get(&z).filter(|(last, _)| x.checked_add(1) == Some(*last)).map_or(1, |(_, count)| count + 1);
        if count >= a {
            return true;
        }
        before.insert(z, (x, count));
    }
    false
}

impl Rule for LevelHas {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            let mut required = json!({ "y": self.y, "blocks": { ">=": self.min_blocks, "<=": self.max_blocks },
                               "parts": { ">=": self.min_parts, "<=": self.max_parts }, "size": { ">=": self.min_size } });
            if self.min_part_blocks > 0 {
                required["blocks_of_each"] = json!({ ">=": self.min_part_blocks });
            }
            if let Some(full) = self.full_size {
                required["full"] = json!({ ">=": full });
            }
            required
        });
        if subject.structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let cells = self.cells(subject);
        let clusters = Clusters::of(&cells, Touch::SidesAndCorners);
        let extents = extents(&cells, &clusters);
        let reaches = |[a, b]: [u32; 2]| extents.iter().any(|[x, z]| (*x >= a && *z >= b) || (*x >= b && *z >= a));
        let is_within = |count: usize, least: u32, most: Option<u32>| {
            count >= least as usize && most.is_none_or(|most| count <= most as usize)
        };
        let mut sizes = vec![0_u32; clusters.count];
        clusters.label.iter().for_each(|label| sizes[*label as usize] += 1);
        let has_parts = is_within(clusters.count, self.min_parts, self.max_parts)
            && sizes.iter().all(|size| *size >= self.min_part_blocks);
        let holds = has_parts
            && is_within(cells.len(), self.min_blocks, self.max_blocks)
            && self.min_size.is_none_or(reaches)
            && self.full_size.is_none_or(|[a, b]| has_rectangle(&cells, a, b) || has_rectangle(&cells, b, a));
        let widest = || extents.iter().max_by_key(|[x, z]| u64::from(*x) * u64::from(*z)).copied().unwrap_or_default();
        let summary = subject.tell(|| {
            let what = self.of.map_or_else(String::new, |of| format!(" of {of}"));
            let wanted = self.wanted().map(|wanted| format!("; required {wanted}")).unwrap_or_default();
            let [wide, long] = widest();
            if cells.is_empty() {
                return format!("at y = {}: no block{what}{wanted}", self.y);
            }
            let (blocks, parts) = (counted(cells.len(), "block"), counted(clusters.count, "separate part"));
            format!("at y = {}: {blocks}{what} in {parts}; the widest part measures {wide} by {long}{wanted}", self.y)
        });
        let measured = subject.tell(|| json!({ "blocks": cells.len(), "parts": clusters.count, "widest": widest() }));
        let finding = Finding::binary(holds, measured, required, summary);
        if has_parts {
            return finding;
        }
        let parts = subject.tell(|| clusters.representatives(&cells)).into_iter();
        finding.with_witnesses(parts.map(|(x, z)| Cell::new(x, self.y, z)), "first block of a part")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::Structure;

    fn holds(check: &serde_json::Value, cells: &[[i32; 3]]) -> bool {
        let structure = Structure::from_named(cells.iter().map(|[x, y, z]| (Cell::new(*x, *y, *z), "stone")));
        let rule: LevelHas = serde_json::from_value(check.clone()).unwrap();
        rule.evaluate(&Subject::unhurried(&structure)).holds()
    }

    #[test]
    fn what_one_walks_through_is_left_out() {
        let blocks = [("stone", 0), ("water", 2), ("torch", 4)].map(|(name, x)| (Cell::new(x, 0, 0), name));
        let has = |solid, parts| {
            let rule = json!({ "y": 0, "min_parts": parts, "max_parts": parts, "solid": solid });
            let rule: LevelHas = serde_json::from_value(rule).unwrap();
            rule.evaluate(&Subject::unhurried(&Structure::from_named(blocks))).holds()
        };
        assert!(has(true, 1) && has(false, 3) && !has(true, 3));
    }

    #[test]
    fn a_full_rectangle_has_no_hole() {
        let plan = |is_left_out: fn(i32, i32) -> bool| {
            (-1..5)
                .flat_map(|x| (-2..2).map(move |z| [x, 1, z]))
                .filter(|[x, _, z]| !is_left_out(*x, *z))
                .collect::<Vec<_>>()
        };
        let has = |cells: &[[i32; 3]], size: [u32; 2]| holds(&json!({ "y": 1, "full_size": size }), cells);
        let whole = plan(|_, _| false);
        assert!(has(&whole, [6, 4]) && has(&whole, [4, 6]) && !has(&whole, [5, 5]) && !has(&whole, [7, 1]));
        let holed = plan(|x, z| (x, z) == (1, 0));
        assert!(!has(&holed, [6, 4]) && has(&holed, [4, 3]) && has(&holed, [2, 6]) && !has(&holed, [3, 6]));
        let strips = plan(|x, z| x > -1 && z > -2);
        assert!(has(&strips, [6, 1]) && has(&strips, [1, 4]) && !has(&strips, [2, 2]), "an L of two strips");
    }

    #[test]
    fn blocks_parts_and_sizes_of_one_level() {
        let bar = [[0, 1, 0], [1, 1, 0], [2, 1, 0], [0, 2, 5], [4, 1, 4]];
        for (check, expected) in [
            (json!({ "y": 1, "min_blocks": 4, "max_blocks": 4 }), true),
            (json!({ "y": 1, "min_blocks": 5 }), false),
            (json!({ "y": 1, "min_parts": 2, "max_parts": 2 }), true),
            (json!({ "y": 1, "max_parts": 1 }), false),
            (json!({ "y": 1, "min_part_blocks": 1 }), true),
            (json!({ "y": 1, "min_part_blocks": 2 }), false),
            (json!({ "y": 1, "min_size": [1, 3] }), true),
            (json!({ "y": 1, "min_size": [2, 2] }), false),
            (json!({ "y": 2, "of": "dirt", "min_blocks": 1 }), false),
            (json!({ "y": 7 }), true),
        ] {
            assert_eq!(holds(&check, &bar), expected, "{check}");
        }
        assert!(!holds(&json!({ "y": 0 }), &[]), "nothing stands");
    }
}
