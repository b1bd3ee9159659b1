//! Doors that can be walked through, and blocks that must touch.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::is_door;
use crate::checks::{Finding, Rule, Subject};
use crate::text::{counted, of_all};
use crate::voxel::CellSet;

/// Check that each door has at least two of its four sides free of blocks other than doors, at its level and one above.
///
/// Of several doors in one column, only the first in building order counts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoorsPassable {}

impl Rule for DoorsPassable {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "blocked": 0 }));
        if subject.structure.is_empty() {
            return Finding::nothing_stands(true, required);
        }
        let structure = subject.structure;
        let door = structure.palette().mask(is_door);
        let mut columns: HashSet<(i32, i32), foldhash::fast::RandomState> = HashSet::default();
        let solid: CellSet = structure.entries().filter(|(_, id)| !door[*id as usize]).map(|(cell, _)| cell).collect();
        let mut blocked = Vec::new();
        let mut doors = 0u32;
        for (cell, id) in structure.entries() {
            if !door[id as usize] || !columns.insert((cell.x, cell.z)) {
                continue;
            }
            doors += 1;
            let shut = |dy: i32| {
                cell.side_neighbours().iter().filter(|side| solid.contains(&side.offset(0, dy, 0))).count() >= 3
            };
            if shut(0) || shut(1) {
                blocked.push(cell);
            }
        }
        let summary = subject.tell(|| match doors {
            0 => "there are no doors".to_owned(),
            _ => of_all(blocked.len(), doors, "door", "is blocked", "are blocked"),
        });
        Finding::binary(blocked.is_empty(), blocked.len(), required, summary)
            .vacuous_if(doors == 0)
            .with_witnesses(blocked, "blocked door")
    }
}

/// Check that a block of the first material shares a face with a block of the second; names compare in lower case.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adjacent {
    /// The two materials; with a list of any other length the check fails, as published.
    pub materials: Vec<String>,
    /// Whether a block matches if its name merely contains the wanted one.
    #[serde(default = "yes")]
    pub substring_match: bool,
}

const fn yes() -> bool {
    true
}

impl Rule for Adjacent {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "touching": self.materials }));
        let [a, b] = self.materials.as_slice() else {
            let summary =
                subject.tell(|| format!("{} given; exactly two are needed", counted(self.materials.len(), "material")));
            return Finding::binary(false, json!(null), required, summary);
        };
        if subject.structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let cells_of = |wanted: &str| {
            let wanted = wanted.to_lowercase();
            subject.structure.cells_of(|name| {
                let name = name.to_lowercase();
                if self.substring_match { name.contains(&wanted) } else { name == wanted }
            })
        };
        let (first, second) = (cells_of(a), cells_of(b));
        let others: CellSet = second.iter().copied().collect();
        let touching = first.iter().find(|cell| cell.face_neighbours().iter().any(|n| others.contains(n)));
        if let Some(&cell) = touching {
            let summary = subject.tell(|| format!("a {a:?} touches a {b:?}"));
            return Finding::binary(true, true, required, summary).with_witnesses([cell], "touches");
        }
        let summary = subject.tell(|| format!("none of {} {a:?} touches any of {} {b:?}", first.len(), second.len()));
        Finding::binary(false, false, required, summary).with_witnesses(first, a).with_witnesses(second, b)
    }
}
