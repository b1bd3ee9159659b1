//! Strict rules for materials: block names must exist in the game, and families replace substrings
//! (`docs/rules.md#strict-rules`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::{agreeing, counted, range_of_counts};
use crate::voxel::blocks::{BlockSet, GAME_VERSION, is_air, is_door, is_known};
use crate::voxel::inside::LEAST_FLOOR;
use crate::voxel::{Cell, CellSet};

/// Check that every block is a block of the game, and that none is air.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlocksKnown {}

/// Check that the number of blocks of a kind or a family lies within bounds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CountWithin {
    /// Blocks to count; null counts all.
    #[serde(default)]
    pub of: Option<BlockSet>,
    /// Least number of blocks.
    #[serde(default)]
    pub min: u32,
    /// Greatest number of blocks; null sets no limit.
    #[serde(default)]
    pub max: Option<u32>,
}

/// Part of a build.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Every block.
    All,
    /// The blocks of a level that lie at an extreme of both x and z.
    Corners,
    /// Each of the four sides of a level, without its corners.
    Sides,
    /// The blocks with none above them, from half the greatest y upwards.
    Roof,
    /// The blocks of a level beside the air of a room; doors are left out.
    RoomWalls,
    /// The blocks of a level that touch the air of rooms at one edge and nowhere else.
    RoomCorners,
    /// The highest block of each column over a room.
    RoomRoof,
    /// The cells of a level straight below the air of rooms, be they filled or not.
    UnderRooms,
}

/// Check that a share of one part of the build is of a kind or a family; of the sides, each one must have that share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MadeOf {
    /// Blocks that the part must be made of.
    pub of: BlockSet,
    /// Part of the build to check.
    pub part: Part,
    /// Level of the corners or sides; other parts ignore it.
    #[serde(default)]
    pub y: i32,
    /// Least share of the part's blocks, from 0 to 1.
    #[serde(default = "whole")]
    pub min_share: f64,
    /// Blocks that are left out; null leaves out none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub except: Option<BlockSet>,
}

const fn whole() -> f64 {
    1.0
}

impl Rule for BlocksKnown {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.structure;
        let required = subject.tell(|| json!({ "unknown": 0 }));
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let unknown = structure.cells_of(|name| !is_known(name) || is_air(name));
        let summary = subject.tell(|| {
            format!(
                "{} not exist in Minecraft {GAME_VERSION}",
                agreeing(unknown.len(), "block is air or does", "blocks are air or do")
            )
        });
        Finding::binary(unknown.is_empty(), unknown.len(), required, summary).with_witnesses(unknown, "no such block")
    }
}

impl Rule for CountWithin {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.structure;
        let found = structure.palette().mask(|name| self.of.is_none_or(|of| of.has(name)));
        // An object in two cells is counted once.
        let is_counted = |(cell, id): &(Cell, u32)| found[*id as usize] && structure.other_half(*cell).is_none();
        let count = structure.entries().filter(is_counted).count();
        let holds = count >= self.min as usize && self.max.is_none_or(|max| count <= max as usize);
        let required = subject.tell(|| json!({ ">=": self.min, "<=": self.max }));
        let summary = subject.tell(|| {
            let of = self.of.map(|of| format!(" of {of}")).unwrap_or_default();
            let bounds = range_of_counts(self.min, self.max).map(|range| format!("; required {range}"));
            format!("{}{of}{}", counted(count, "block"), bounds.unwrap_or_default())
        });
        Finding::binary(holds, count, required, summary).vacuous_if(holds && structure.is_empty())
    }
}

impl MadeOf {
    /// Returns whether the part is that of a room, to find which takes a walk through the space around the build.
    #[must_use]
    pub const fn is_of_rooms(&self) -> bool {
        matches!(self.part, Part::RoomWalls | Part::RoomCorners | Part::RoomRoof | Part::UnderRooms)
    }
}

/// Returns the groups of entries that a part consists of; the required share applies to each group.
fn entries_of(part: Part, y: i32, subject: &Subject<'_>) -> Vec<Vec<usize>> {
    let structure = subject.structure;
    let cells = structure.cells();
    let level = || (0..cells.len()).filter(|&i| cells[i].y == y);
    let bounds = crate::voxel::Bounds::of(level().map(|i| cells[i]));
    let Some(bounds) = bounds.filter(|_| matches!(part, Part::Corners | Part::Sides)) else {
        let is_roof = |cell: Cell| !structure.contains(cell.offset(0, 1, 0));
        return match part {
            Part::All => vec![(0..cells.len()).collect()],
            Part::Roof => {
                let top = cells.iter().map(|cell| cell.y).max().unwrap_or(0);
                // Only blocks in the upper half count as the roof, which excludes ledges and doors.
                vec![(0..cells.len()).filter(|&i| is_roof(cells[i]) && 2 * cells[i].y >= top).collect()]
            }
            Part::RoomWalls | Part::RoomCorners | Part::RoomRoof => vec![of_rooms(part, y, subject)],
            // `under_rooms` returns what empty cells belong to as well.
            Part::UnderRooms | Part::Corners | Part::Sides => vec![Vec::new()],
        };
    };
    let on_x = |c: Cell| c.x == bounds.min.x || c.x == bounds.max.x;
    let on_z = |c: Cell| c.z == bounds.min.z || c.z == bounds.max.z;
    if part == Part::Corners {
        return vec![level().filter(|&i| on_x(cells[i]) && on_z(cells[i])).collect()];
    }
    let side = |is_on: &dyn Fn(Cell) -> bool| level().filter(|&i| is_on(cells[i])).collect();
    vec![
        side(&|c| c.x == bounds.min.x && !on_z(c)),
        side(&|c| c.x == bounds.max.x && !on_z(c)),
        side(&|c| c.z == bounds.min.z && !on_x(c)),
        side(&|c| c.z == bounds.max.z && !on_x(c)),
    ]
}

/// Returns the entries that lie straight below the air of rooms on a level, and the other cells there, which are empty or
/// natural ground.
fn under_rooms(y: i32, subject: &Subject<'_>) -> (Vec<usize>, Vec<Cell>) {
    let Some(around) = subject.surroundings() else { return (Vec::new(), Vec::new()) };
    let air = around.terrain.cells_of(around.spaces(), &around.rooms(LEAST_FLOOR));
    let mut bare: CellSet = air.filter(|cell| cell.y > y).map(|cell| Cell::new(cell.x, y, cell.z)).collect();
    let entries = subject.structure.cells().iter().enumerate();
    let filled = entries.filter(|(_, cell)| bare.remove(cell)).map(|(i, _)| i).collect();
    let mut bare: Vec<Cell> = bare.into_iter().collect();
    bare.sort_unstable();
    (filled, bare)
}

/// Returns the entries of a part that rooms define.
fn of_rooms(part: Part, y: i32, subject: &Subject<'_>) -> Vec<usize> {
    let Some(around) = subject.surroundings() else { return Vec::new() };
    let (terrain, spaces) = (&around.terrain, around.spaces());
    let structure = subject.structure;
    let rooms = around.rooms(LEAST_FLOOR);
    // Only the level that is asked for, or for the roof one cell of each column.
    let is_wanted = |cell: &Cell| part == Part::RoomRoof || cell.y == y;
    let flat = |cell: Cell| if part == Part::RoomRoof { Cell::new(cell.x, 0, cell.z) } else { cell };
    let air: CellSet = terrain.cells_of(spaces, &rooms).filter(is_wanted).map(flat).collect();
    let cells = structure.cells();
    if part == Part::RoomRoof {
        let mut highest: BTreeMap<(i32, i32), usize> = BTreeMap::new();
        for (i, cell) in cells.iter().enumerate().filter(|(_, cell)| air.contains(&Cell::new(cell.x, 0, cell.z))) {
            let top = highest.entry((cell.x, cell.z)).or_insert(i);
            if cells[*top].y < cell.y {
                *top = i;
            }
        }
        return highest.into_values().collect();
    }
    let doors = structure.palette().mask(is_door);
    let is_beside = |cell: Cell| cell.side_neighbours().iter().any(|side| air.contains(side));
    // Where a wall between two rooms meets an outer one, both rooms are at an edge: that is no corner.
    let is_at_one_edge = |cell: Cell| {
        let edges = [(1, 1), (1, -1), (-1, 1), (-1, -1)].map(|(dx, dz)| cell.offset(dx, 0, dz));
        edges.iter().filter(|edge| air.contains(edge)).count() == 1
    };
    let level = (0..cells.len()).filter(|&i| cells[i].y == y && !air.contains(&cells[i]));
    let level = level.filter(|&i| !doors[structure.material_ids()[i] as usize]);
    match part {
        Part::RoomWalls => level.filter(|&i| is_beside(cells[i])).collect(),
        _ => level.filter(|&i| !is_beside(cells[i]) && is_at_one_edge(cells[i])).collect(),
    }
}

impl Rule for MadeOf {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.structure;
        let required = subject.tell(|| json!({ "of": self.of, "share >=": self.min_share }));
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let own = structure.palette().mask(|name| self.of.has(name));
        let is_own = |&i: &usize| own[structure.material_ids()[i] as usize];
        let (mut parts, bare) = match self.part {
            Part::UnderRooms => {
                let (filled, bare) = under_rooms(self.y, subject);
                (vec![filled], bare)
            }
            part => (entries_of(part, self.y, subject), Vec::new()),
        };
        if let Some(except) = self.except {
            let left_out = structure.palette().mask(|name| except.has(name));
            for part in &mut parts {
                part.retain(|&i| !left_out[structure.material_ids()[i] as usize]);
            }
        }
        // A level needs at least four corner blocks to have corners; an empty part fails.
        let has_corners = matches!(self.part, Part::Corners | Part::RoomCorners);
        let is_whole = |cells: usize| cells >= if has_corners { 4 } else { 1 };
        let share = |part: &Vec<usize>| {
            let own = part.iter().filter(|i| is_own(i)).count();
            let all = part.len() + bare.len();
            if is_whole(all) { own as f64 / all as f64 } else { 0.0 }
        };
        let least = parts.iter().map(share).fold(1.0, f64::min);
        let summary = subject.tell(|| {
            if self.is_of_rooms() && bare.is_empty() && parts.iter().all(Vec::is_empty) {
                format!("no room was found, so there is no part of it to be of {}", self.of)
            } else {
                format!("{:.0} % of the part is of {}", 100.0 * least, self.of)
            }
        });
        let others = parts.iter().flatten().filter(|i| !is_own(i)).map(|&i| structure.cells()[i]);
        let finding = Finding::binary(least >= self.min_share, least, required, summary);
        finding.with_witnesses(others, "another material").with_witnesses(bare, "no block of the build")
    }
}
