//! Strict rule for what stands at one level: how many blocks, in how many parts, and how far they reach
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::{counted, range_of_counts};
use crate::voxel::blocks::BlockSet;
use crate::voxel::planar::{Clusters, PlaneCell, Touch, sorted_distinct};
use crate::voxel::{Cell, Structure};

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
}

impl LevelHas {
    /// Returns the bounds in words, or `None` if there are none.
    fn wanted(&self) -> Option<String> {
        let blocks = range_of_counts(self.min_blocks, self.max_blocks).map(|range| format!("blocks: {range}"));
        let parts = range_of_counts(self.min_parts, self.max_parts).map(|range| format!("parts: {range}"));
        let size = self.min_size.map(|[a, b]| format!("a part of at least {a} by {b}"));
        let all: Vec<String> = [blocks, parts, size].into_iter().flatten().collect();
        (!all.is_empty()).then(|| all.join(", "))
    }

    fn cells(&self, structure: &Structure) -> Vec<PlaneCell> {
        let own = structure.palette().mask(|name| self.of.is_none_or(|of| of.has(name)));
        let at = structure.entries().filter(|(cell, id)| cell.y == self.y && own[*id as usize]);
        sorted_distinct(at.map(|(cell, _)| (cell.x, cell.z)).collect())
    }
}

/// Returns the extents along x and z of each cluster.
fn extents(cells: &[PlaneCell], clusters: &Clusters) -> Vec<[u32; 2]> {
    let mut bounds: Vec<Option<[i32; 4]>> = vec![None; clusters.count];
    for (&(x, z), label) in cells.iter().zip(&clusters.label) {
        let [x0, x1, z0, z1] = bounds[*label as usize].unwrap_or([x, x, z, z]);
        bounds[*label as usize] = Some([x0.min(x), x1.max(x), z0.min(z), z1.max(z)]);
    }
    bounds.into_iter().flatten().map(|[x0, x1, z0, z1]| [x0.abs_diff(x1) + 1, z0.abs_diff(z1) + 1]).collect()
}

impl Rule for LevelHas {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "y": self.y, "blocks": { ">=": self.min_blocks, "<=": self.max_blocks },
                               "parts": { ">=": self.min_parts, "<=": self.max_parts }, "size": { ">=": self.min_size } }));
        if subject.structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let cells = self.cells(subject.structure);
        let clusters = Clusters::of(&cells, Touch::SidesAndCorners);
        let extents = extents(&cells, &clusters);
        let reaches = |[a, b]: [u32; 2]| extents.iter().any(|[x, z]| (*x >= a && *z >= b) || (*x >= b && *z >= a));
        let is_within = |count: usize, least: u32, most: Option<u32>| {
            count >= least as usize && most.is_none_or(|most| count <= most as usize)
        };
        let has_parts = is_within(clusters.count, self.min_parts, self.max_parts);
        let holds =
            has_parts && is_within(cells.len(), self.min_blocks, self.max_blocks) && self.min_size.is_none_or(reaches);
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

    fn holds(check: &serde_json::Value, cells: &[[i32; 3]]) -> bool {
        let structure = Structure::from_named(cells.iter().map(|[x, y, z]| (Cell::new(*x, *y, *z), "stone")));
        let rule: LevelHas = serde_json::from_value(check.clone()).unwrap();
        rule.evaluate(&Subject::unhurried(&structure)).holds()
    }

    #[test]
    fn blocks_parts_and_sizes_of_one_level() {
        let bar = [[0, 1, 0], [1, 1, 0], [2, 1, 0], [0, 2, 5], [4, 1, 4]];
        for (check, expected) in [
            (json!({ "y": 1, "min_blocks": 4, "max_blocks": 4 }), true),
            (json!({ "y": 1, "min_blocks": 5 }), false),
            (json!({ "y": 1, "min_parts": 2, "max_parts": 2 }), true),
            (json!({ "y": 1, "max_parts": 1 }), false),
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
