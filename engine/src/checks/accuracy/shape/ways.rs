//! Strict rules for walkable paths: outside over floors, and up in steps from any ground
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::enclosed::without_terrain;
use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::blocks::BlockSet;
use crate::voxel::planar::{Clusters, Touch, level, rectangles};
use crate::voxel::{Cell, CellMap, CellSet, Structure};

/// Check that from an inside cell beside each block of a kind, a path with a floor at every step leads outside.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WalksOut {
    /// Blocks beside which the paths start.
    pub from: BlockSet,
    /// Least number of such blocks.
    #[serde(default = "one")]
    pub min_starts: u32,
    /// Greatest step up or down, in blocks: 0 for a path without steps; values above 1 count as 1.
    #[serde(default = "one")]
    pub max_step: u32,
    /// Width of the path, in cells: 1 or 2.
    #[serde(default = "one")]
    pub width: u32,
    /// Whether the cell above each block must be enclosed air.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub indoors: bool,
}

/// Check that one can walk and climb from the ground around the build to enough enclosed cells of floor at a level.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasUpperFloor {
    /// Least y of the floor's blocks.
    pub min_y: i32,
    /// Least number of enclosed cells in which one can stand on it.
    #[serde(default = "four")]
    pub min_cells: u32,
    /// Least number of such cells on the ground floor: at y = 0, or one above it.
    #[serde(default, skip_serializing_if = "super::is_zero")]
    pub ground_cells: u32,
}

const fn four() -> u32 {
    4
}

/// Check that a path in steps of one block climbs from the ground around the build to a block at a level.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClimbsTo {
    /// Least y of the block at the end of the path.
    pub min_y: i32,
    /// Whether that block must lie within the plan of the floor at `min_y`: the largest rectangle around a part of that
    /// level.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub onto_floor: bool,
}

const fn one() -> u32 {
    1
}

/// Greatest width of a path, in cells.
const MAX_WIDTH: u32 = 2;

impl Rule for WalksOut {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "starts": { ">=": self.min_starts }, "stuck": 0 }));
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let (terrain, spaces) = (&around.terrain, around.spaces());
        let blocks = subject.structure.cells_of(|name| self.from.has(name));
        let first = |cell: &Cell| subject.structure.other_half(*cell).unwrap_or(*cell);
        let mut halves: CellMap<Vec<Cell>> = CellMap::default();
        for block in &blocks {
            halves.entry(first(block)).or_default().push(*block);
        }
        let starts: Vec<Cell> = blocks.iter().copied().filter(|cell| first(cell) == *cell).collect();
        let (step, width) = (self.max_step.min(1), self.width.clamp(1, MAX_WIDTH) as i32);
        // Steps work in both directions, so a path in from the outside is also a path out.
        let ways_out: CellSet = if width == 1 {
            around.walked(step).iter().copied().collect()
        } else {
            terrain.reached(terrain.around(width), step as i32, width).into_iter().collect()
        };
        let square = || (0..width).flat_map(move |dx| (0..width).map(move |dz| (dx, dz)));
        // Squares that contain an enclosed cell beside the block.
        let gets_out = |start: &Cell| {
            let own = halves.get(start).into_iter().flatten();
            own.flat_map(|half| half.side_neighbours())
                .filter(|side| terrain.is_enclosed(*side, spaces))
                .flat_map(|side| square().map(move |(dx, dz)| side.offset(-dx, 0, -dz)))
                .any(|at| ways_out.contains(&at))
        };
        let is_inside = |start: &Cell| {
            let mut own = halves.get(start).into_iter().flatten();
            !self.indoors || own.any(|half| terrain.is_enclosed(half.offset(0, 1, 0), spaces))
        };
        let stuck: Vec<Cell> = starts.iter().copied().filter(|start| !is_inside(start) || !gets_out(start)).collect();
        let holds = stuck.is_empty() && starts.len() >= self.min_starts as usize;
        let summary = subject.tell(|| {
            let (all, from) = (starts.len(), self.from);
            let blocks = format!("{} of {from}", counted(all, "block"));
            match stuck.len() {
                _ if all < self.min_starts as usize => {
                    format!("{blocks} to start from; required at least {}", self.min_starts)
                }
                0 if all == 0 => format!("{blocks} to start from, and none is required"),
                0 if all == 1 => format!("a path {width} wide leads outside from {blocks}"),
                0 => format!("a path {width} wide leads outside from each of {blocks}"),
                some if self.indoors => {
                    format!(
                        "no path {width} wide leads outside from {some} of {blocks}, or no air of a room lies above"
                    )
                }
                some => format!("no path {width} wide leads outside from {some} of {blocks}"),
            }
        });
        let measured = subject.tell(|| json!({ "starts": starts.len(), "stuck": stuck.len() }));
        Finding::binary(holds, measured, required, summary)
            .vacuous_if(holds && starts.is_empty())
            .with_witnesses(stuck, "no path outside")
    }
}

impl Rule for HasUpperFloor {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            let mut required = json!({ "cells": { ">=": self.min_cells }, "y": { ">=": self.min_y } });
            if self.ground_cells > 0 {
                required["on_ground"] = json!({ ">=": self.ground_cells });
            }
            required
        });
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let (terrain, spaces) = (&around.terrain, around.spaces());
        let walked = || around.walked(1).iter().copied();
        let is_inside = |feet: &Cell| terrain.is_floor(*feet) && terrain.is_enclosed(*feet, spaces);
        let on_ground = match self.ground_cells {
            0 => 0,
            _ => walked().filter(|feet| feet.y <= 1).filter(is_inside).count(),
        };
        let reached: Vec<Cell> = walked().filter(|feet| feet.y > self.min_y).filter(is_inside).collect();
        let summary = subject.tell(|| {
            let ground = (self.ground_cells > 0).then(|| format!(", and {on_ground} on the ground floor"));
            let least = (self.ground_cells > 0).then(|| format!(" and {}", self.ground_cells));
            format!(
                "{} of floor at y = {} or higher can be reached from outside{}; required at least {}{}",
                counted(reached.len(), "enclosed cell"),
                self.min_y,
                ground.unwrap_or_default(),
                self.min_cells,
                least.unwrap_or_default()
            )
        });
        let holds = reached.len() >= self.min_cells as usize && on_ground >= self.ground_cells as usize;
        let measured = subject.tell(|| match self.ground_cells {
            0 => json!(reached.len()),
            _ => json!({ "cells": reached.len(), "on_ground": on_ground }),
        });
        Finding::binary(holds, measured, required, summary)
            .with_witnesses(reached.first().map(|feet| feet.offset(0, -1, 0)), "upper floor")
    }
}

/// Returns the largest rectangle around a part of a level, as its least and greatest x, and its least and greatest z.
fn floor_plan(structure: &Structure, y: i32) -> Option<[i32; 4]> {
    let cells = level(structure, y);
    let parts = Clusters::of(&cells, Touch::SidesAndCorners);
    let area = |[x0, x1, z0, z1]: &[i32; 4]| u64::from(x0.abs_diff(*x1) + 1) * u64::from(z0.abs_diff(*z1) + 1);
    // The first of equally large ones.
    rectangles(&cells, &parts).into_iter().rev().max_by_key(area)
}

impl Rule for ClimbsTo {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_y }));
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let plan = self.onto_floor.then(|| floor_plan(subject.structure, self.min_y));
        let is_over = |block: &Cell| {
            let is_within = |[x0, x1, z0, z1]: [i32; 4]| (x0..=x1).contains(&block.x) && (z0..=z1).contains(&block.z);
            plan.is_none_or(|plan| plan.is_some_and(is_within))
        };
        let blocks = around.walked(1).iter().map(|feet| feet.offset(0, -1, 0)).filter(is_over);
        let highest = blocks.max_by_key(|block| (block.y, *block));
        let Some(block) = highest else {
            let summary = if self.onto_floor {
                subject.tell(|| format!("no climb from the ground ends over the floor at y = {}", self.min_y))
            } else {
                "no block can be climbed from the ground".to_owned()
            };
            return Finding::binary(false, json!(null), required, summary);
        };
        let y = block.y;
        let summary =
            subject.tell(|| format!("the climb reaches a block at y = {y}; required {} or higher", self.min_y));
        Finding::binary(y >= self.min_y, y, required, summary).with_witnesses(highest, "highest block reached")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::{Profile, Reading};

    /// A closed tower with a door, a floor at y = 3 with a hole at (1, 3, 1), and rungs below the hole.
    fn tower(inside: i32, rungs: std::ops::Range<i32>) -> Structure {
        let last = inside + 1;
        let mut blocks = Vec::new();
        for (x, z) in (0..=last).flat_map(|x| (0..=last).map(move |z| (x, z))) {
            let is_wall = x == 0 || z == 0 || x == last || z == last;
            let is_door = (x, z) == (1, 0);
            let wall = (0..7).filter(|y| is_wall && !(is_door && *y < 2));
            let slab = [3, 7].into_iter().filter(|y| *y == 7 || (x, z) != (1, 1));
            blocks.extend(wall.chain(slab).map(|y| (Cell::new(x, y, z), "stone")));
        }
        blocks.push((Cell::new(1, 0, 0), "oak_door"));
        blocks.extend(rungs.map(|y| (Cell::new(1, y, 1), "ladder")));
        let mut taken = CellSet::default();
        blocks.retain(|(cell, _)| taken.insert(*cell));
        Reading::Game.read(Structure::from_named(blocks), Profile::Mindcraft)
    }

    fn reaches_with(structure: &Structure, ground_cells: u32) -> bool {
        let rule = HasUpperFloor { min_y: 3, min_cells: 9, ground_cells };
        rule.evaluate(&Subject::unhurried(structure)).holds()
    }

    fn reaches(structure: &Structure) -> bool {
        reaches_with(structure, 0)
    }

    #[test]
    fn stairs_lead_onto_the_floor_or_elsewhere() {
        let climbs = |stairs_at: i32| {
            let floor = (0..5).flat_map(|x| (0..5).map(move |z| Cell::new(x, 3, z)));
            let stairs = (0..4).flat_map(|step| (0..=step).map(move |y| Cell::new(stairs_at, y, 3 - step)));
            let all = Structure::from_named(floor.chain(stairs).map(|cell| (cell, "stone")));
            [false, true]
                .map(|onto_floor| ClimbsTo { min_y: 3, onto_floor }.evaluate(&Subject::unhurried(&all)).holds())
        };
        assert_eq!(climbs(5), [true, true], "beside the floor, so one steps onto it");
        assert_eq!(climbs(9), [true, false], "elsewhere");
    }

    #[test]
    fn a_ladder_leads_up_and_its_rungs_are_no_floor() {
        assert!(reaches(&tower(4, 0..4)) && reaches_with(&tower(4, 0..4), 15) && !reaches_with(&tower(4, 0..4), 16));
        assert!(!reaches(&tower(4, 0..0)), "no way up");
        assert!(!reaches(&tower(4, 0..2)), "the ladder ends below the floor");
        assert!(!reaches(&tower(1, 0..7)), "a shaft full of rungs has no floor");
    }
}
