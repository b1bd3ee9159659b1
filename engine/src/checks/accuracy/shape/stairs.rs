//! Climbing by stairs (`docs/rules.md#shape`; paper, algorithm "Reachability by Stairs").

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Amount, Finding, Rule, Subject};
use crate::voxel::{Cell, CellSet};

/// Check that from some block at y = 0, steps on the level or one up lead to a height, with two free cells above each
/// block.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReachableByStairs {
    /// Least y of the highest block reached.
    pub min_floor_y: Amount,
}

impl Rule for ReachableByStairs {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_floor_y }));
        let structure = subject.structure;
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let stands = |cell: Cell| structure.contains(cell);
        let has_room = |cell: Cell| !stands(cell.offset(0, 1, 0)) && !stands(cell.offset(0, 2, 0));
        let mut seen = CellSet::default();
        let mut open: Vec<Cell> = Vec::new();
        for &cell in structure.cells() {
            if cell.y == 0 && has_room(cell) && seen.insert(cell) {
                open.push(cell);
            }
        }
        let mut highest: Option<Cell> = None;
        while let Some(cell) = open.pop() {
            if highest.is_none_or(|best| (cell.y, cell) > (best.y, best)) {
                highest = Some(cell);
            }
            for side in cell.side_neighbours() {
                for next in [side, side.offset(0, 1, 0)] {
                    if stands(next) && has_room(next) && seen.insert(next) {
                        open.push(next);
                    }
                }
            }
        }
        let Some(highest) = highest else {
            let summary = "no block at y = 0 has two free cells above it to start from";
            return Finding::binary(false, json!(null), required, summary);
        };
        let holds = f64::from(highest.y) >= self.min_floor_y.0;
        let summary =
            subject.tell(|| format!("stairs lead up to y = {}; required {} or higher", highest.y, self.min_floor_y));
        Finding::binary(holds, highest.y, required, summary).with_witnesses([highest], "highest block reached")
    }
}
