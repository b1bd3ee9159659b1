//! Strict rules for rooms and doors: a room has walls, a roof, head room and a door, on any storey
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Finding, Rule, Subject};
use crate::text::{counted, of_all, range_of_counts};
use crate::voxel::terrain::MAX_EXTENT;

/// Check that there are enough enclosed regions of air with standing room that doors connect to the outside.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnclosedRooms {
    /// Least number of rooms.
    pub min_rooms: u32,
    /// Greatest number of rooms, together with closed spaces of that size that nobody can enter; null sets no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_rooms: Option<u32>,
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
    let summary = subject.tell(|| format!("the build measures more than {MAX_EXTENT} blocks along an axis"));
    Finding::binary(false, Value::Null, required, summary)
}

/// Enclosed spaces that a finding shows.
#[derive(Debug, Clone, Copy)]
enum Shown {
    Rooms,
    NoRooms,
    /// Closed spaces that have the size of a room.
    ClosedOfSize,
}

impl EnclosedRooms {
    /// Returns the bounds in words, or `None` if there are none.
    fn wanted(&self) -> Option<String> {
        let least = range_of_counts(self.min_rooms, None);
        // Only a greatest number counts the spaces that nobody can enter.
        let most = self.max_rooms.map(|most| format!("at most {most} together with closed spaces as large as a room"));
        let both: Vec<String> = [least, most].into_iter().flatten().collect();
        (!both.is_empty()).then(|| format!("; required {}", both.join(", and ")))
    }
}

impl Rule for EnclosedRooms {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| match self.max_rooms {
            None => json!({ ">=": self.min_rooms }),
            Some(most) => json!({ "rooms": { ">=": self.min_rooms }, "rooms_and_closed": { "<=": most } }),
        });
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let spaces = around.spaces();
        let rooms = around.rooms(self.min_floor_cells);
        let closed = spaces.pieces.len() - 1 - rooms.len();
        // Closed spaces that nobody can enter count against a greatest number: doors alone would open them.
        let of_size = spaces.pieces[1..].iter().filter(|piece| piece.floor_cells >= self.min_floor_cells).count();
        let is_not_too_many = self.max_rooms.is_none_or(|most| of_size <= most as usize);
        let holds = rooms.len() >= self.min_rooms as usize && is_not_too_many;
        let summary = subject.tell(|| {
            format!(
                "{} with a roof, a door and head room; {}{}",
                counted(rooms.len(), "room"),
                counted(closed, "other enclosed space"),
                self.wanted().unwrap_or_default()
            )
        });
        // What explains a fault: spaces that are no rooms if rooms are missing, and those that count against the greatest
        // number if there are too many.
        let lacks_rooms = rooms.len() < self.min_rooms as usize;
        let is_room = |piece: usize| rooms.binary_search(&piece).is_ok();
        let is_of_size = |piece: usize| spaces.pieces[piece].floor_cells >= self.min_floor_cells;
        let (shown, why) = match (lacks_rooms, is_not_too_many, of_size > rooms.len()) {
            (true, ..) => (Shown::NoRooms, "enclosed, but no room"),
            (false, false, true) => (Shown::ClosedOfSize, "closed space, which nobody can enter"),
            _ => (Shown::Rooms, "room"),
        };
        let is_shown = |piece: &usize| match shown {
            Shown::Rooms => is_room(*piece),
            Shown::NoRooms => !is_room(*piece),
            Shown::ClosedOfSize => !is_room(*piece) && is_of_size(*piece),
        };
        let witnesses = subject.tell(|| (1..spaces.pieces.len()).filter(is_shown).collect::<Vec<_>>());
        let witnesses = witnesses.into_iter().map(|piece| spaces.pieces[piece].first);
        let measured = subject.tell(|| match self.max_rooms {
            None => json!(rooms.len()),
            Some(_) => json!({ "rooms": rooms.len(), "closed": of_size - rooms.len() }),
        });
        Finding::binary(holds, measured, required, summary).with_witnesses(witnesses, why)
    }
}

impl Rule for DoorsLeadThrough {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "doors": { ">=": self.min_doors }, "blocked": 0 }));
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let (terrain, spaces) = (&around.terrain, around.spaces());
        let doors = terrain.doors();
        let blocked: Vec<_> = doors.iter().copied().filter(|door| terrain.joins(*door, spaces).is_none()).collect();
        let holds = blocked.is_empty() && doors.len() >= self.min_doors as usize;
        let summary = subject.tell(|| {
            let required = counted(self.min_doors, "door");
            let found = match doors.len() {
                0 => "no door".to_owned(),
                all => of_all(blocked.len(), all, "door", "is blocked", "are blocked"),
            };
            format!("{found}; required at least {required}")
        });
        let measured = subject.tell(|| json!({ "doors": doors.len(), "blocked": blocked.len() }));
        Finding::binary(holds, measured, required, summary).with_witnesses(blocked, "blocked")
    }
}
