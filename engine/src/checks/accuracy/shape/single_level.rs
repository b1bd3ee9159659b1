//! Flat paths from every bed (or seat) to the outside (`docs/rules.md#ways-out`; paper, algorithm "Flat Exit Path").

use std::collections::HashSet;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::exits::starts;
use super::{contains_lower, is_door};
use crate::checks::{Finding, Rule, Subject};
use crate::text::of_all;
use crate::voxel::planar::PlaneCell;
use crate::voxel::{Bounds, Cell, CellSet};

/// Check that from every start a path over floor cells of the lowest level leads outside, with head room all the way.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SingleLevel {
    /// Starts at blocks whose lower-cased name contains this; null starts at the centre of the bounding box.
    #[serde(default)]
    pub start_material: Option<String>,
}

const fn sides((x, z): PlaneCell) -> [PlaneCell; 4] {
    [(x + 1, z), (x - 1, z), (x, z + 1), (x, z - 1)]
}

/// Walkable floor of the lowest level.
struct Floor {
    y: i32,
    cells: HashSet<PlaneCell, foldhash::fast::RandomState>,
    /// The same cells, in building order.
    listed: Vec<Cell>,
    /// Bounds of the floor's cells in plan.
    bounds: Bounds,
    /// All blocks except doors.
    solid: CellSet,
}

impl Floor {
    /// Returns whether the head cell above this floor cell is free. Above a floor cell that carries a block, such as a
    /// bed, the head cell is one higher.
    fn has_head_room(&self, (x, z): PlaneCell) -> bool {
        let above = Cell::new(x, self.y + 1, z);
        let head = if self.solid.contains(&above) { above.offset(0, 1, 0) } else { above };
        !self.solid.contains(&head)
    }

    fn is_outside(&self, (x, z): PlaneCell) -> bool {
        self.bounds.is_outside_in_plan(x, z)
    }

    fn can_step_to(&self, at: PlaneCell) -> bool {
        if self.cells.contains(&at) {
            return self.has_head_room(at);
        }
        let floor = Cell::new(at.0, self.y, at.1);
        self.is_outside(at) && !self.solid.contains(&floor) && !self.solid.contains(&floor.offset(0, 1, 0))
    }

    /// Returns the floor cells from which the outside can be reached. One search back from the edge serves all starts.
    fn ways_out(&self) -> HashSet<PlaneCell, foldhash::fast::RandomState> {
        let is_exit = |at: PlaneCell| sides(at).into_iter().any(|n| self.is_outside(n) && self.can_step_to(n));
        let mut reached: HashSet<PlaneCell, _> = HashSet::default();
        let mut open: Vec<PlaneCell> = Vec::new();
        for at in self.listed.iter().map(|cell| (cell.x, cell.z)) {
            if is_exit(at) && reached.insert(at) {
                open.push(at);
            }
        }
        while let Some(at) = open.pop() {
            // A path may start at a cell without head room, but not step onto it.
            if !self.has_head_room(at) {
                continue;
            }
            for next in sides(at) {
                if self.cells.contains(&next) && reached.insert(next) {
                    open.push(next);
                }
            }
        }
        reached
    }
}

impl Rule for SingleLevel {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "stuck": 0 }));
        let structure = subject.structure;
        let Some(bounds) = structure.bounds() else {
            return Finding::nothing_stands(true, required);
        };
        let y = bounds.min.y;
        if y > -1 {
            let summary = subject.tell(|| format!("the lowest level is y = {y}; required -1 or lower"));
            return Finding::binary(false, json!({ "floor": y }), required, summary);
        }
        let starts = starts(structure, &bounds, self.start_material.as_deref());
        if starts.is_empty() {
            let material = self.start_material.as_deref().unwrap_or_default();
            let summary = subject.tell(|| format!("no block matches {material:?}: no exit is required"));
            return Finding::binary(true, json!(null), required, summary).vacuous_if(true);
        }
        let mut floor_cells: Vec<Cell> = structure.cells().iter().copied().filter(|c| c.y == y).collect();
        if let Some(material) = self.start_material.as_deref().filter(|m| !m.is_empty()) {
            let on_floor = structure.cells_of(|name| contains_lower(name, material));
            floor_cells.extend(on_floor.into_iter().filter(|c| c.y == y + 1));
        }
        let Some(floor_bounds) = Bounds::of(floor_cells.iter().copied()) else {
            return Finding::nothing_stands(true, required);
        };
        let floor = Floor {
            y,
            cells: floor_cells.iter().map(|c| (c.x, c.z)).collect(),
            listed: floor_cells,
            bounds: floor_bounds,
            solid: structure.cells_of(|name| !is_door(name)).into_iter().collect(),
        };
        let ways_out = floor.ways_out();
        let gets_out = |start: &Cell| {
            let at = (start.x, start.z);
            let leads_out = |n: PlaneCell| floor.is_outside(n) || ways_out.contains(&n);
            let has_way = || sides(at).into_iter().any(|n| floor.can_step_to(n) && leads_out(n));
            start.y == y + 1 && floor.can_step_to(at) && has_way()
        };
        let stuck: Vec<Cell> = starts.iter().copied().filter(|start| !gets_out(start)).collect();
        let summary = subject.tell(|| match (stuck.len(), starts.len()) {
            (0, 1) => format!("the only start has a flat path outside at y = {y}"),
            (0, all) => format!("each of {all} starts has a flat path outside at y = {y}"),
            (some, all) => format!("{} no flat path outside at y = {y}", of_all(some, all, "start", "has", "have")),
        });
        Finding::binary(stuck.is_empty(), stuck.len(), required, summary).with_witnesses(stuck, "no flat path outside")
    }
}
