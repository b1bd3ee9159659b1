//! Strict rules for rooms and doors: a room has walls, a roof, head room and a door, on any storey (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::terrain::{MAX_EXTENT, Terrain};

/// Check that there are enough enclosed regions of air with standing room that doors connect to the outside.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnclosedRooms {
    /// Least number of rooms.
    pub min_rooms: u32,
    /// Least number of cells with standing room in a room.
    #[serde(default = "four")]
    pub min_floor_cells: u32,
}

/// Check that there are enough doors, and that each has standing room on two opposite sides.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoorsLeadThrough {
    /// Least number of doors.
    #[serde(default = "one")]
    pub min_doors: u32,
}

const fn four() -> u32 {
    4
}

const fn one() -> u32 {
    1
}

/// Returns the finding for a build that is empty or too large for these rules.
pub(super) fn without_terrain(subject: &Subject<'_>, required: Value) -> Finding {
    if subject.structure.is_empty() {
        return Finding::nothing_stands(false, required);
    }
    let summary = format!("the build measures more than {MAX_EXTENT} blocks along an axis");
    Finding::binary(false, Value::Null, required, summary)
}

impl Rule for EnclosedRooms {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = json!({ ">=": self.min_rooms });
        let Some(terrain) = Terrain::of(subject.structure) else { return without_terrain(subject, required) };
        let spaces = terrain.spaces();
        let mut beyond: Vec<Vec<usize>> = vec![Vec::new(); spaces.pieces.len()];
        for [one, other] in terrain.doors().iter().filter_map(|door| terrain.joins(*door, &spaces)) {
            beyond[one].push(other);
            beyond[other].push(one);
        }
        // Search from outside through one door after another.
        let mut is_entered = vec![false; spaces.pieces.len()];
        let mut open = vec![0];
        while let Some(piece) = open.pop() {
            if !std::mem::replace(&mut is_entered[piece], true) {
                open.extend(&beyond[piece]);
            }
        }
        let rooms: Vec<usize> = (1..spaces.pieces.len())
            .filter(|&piece| is_entered[piece] && spaces.pieces[piece].floor_cells >= self.min_floor_cells)
            .collect();
        let closed = spaces.pieces.len() - 1 - rooms.len();
        let holds = rooms.len() >= self.min_rooms as usize;
        let summary = format!(
            "{} rooms with a roof, a door and head room; {closed} other enclosed spaces; required {}",
            rooms.len(),
            self.min_rooms
        );
        Finding::binary(holds, rooms.len(), required, summary)
            .with_witnesses(rooms.iter().map(|&room| spaces.pieces[room].first), "room")
    }
}

impl Rule for DoorsLeadThrough {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = json!({ "doors": { ">=": self.min_doors }, "blocked": 0 });
        let Some(terrain) = Terrain::of(subject.structure) else { return without_terrain(subject, required) };
        let spaces = terrain.spaces();
        let doors = terrain.doors();
        let blocked: Vec<_> = doors.iter().copied().filter(|door| terrain.joins(*door, &spaces).is_none()).collect();
        let holds = blocked.is_empty() && doors.len() >= self.min_doors as usize;
        let summary = format!(
            "{} of {} doors are blocked; required {}",
            blocked.len(),
            doors.len(),
            counted(self.min_doors, "door")
        );
        Finding::binary(holds, json!({ "doors": doors.len(), "blocked": blocked.len() }), required, summary)
            .with_witnesses(blocked, "blocked")
    }
}
