//! Strict rules for rooms and doors: a room has walls, a roof, head room and a door, on any storey
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Finding, Rule, Subject};
use crate::text::{agreeing, counted, of_all, range_of_counts};
use crate::voxel::terrain::MAX_EXTENT;

/// Check that there are enough enclosed regions of air with standing room that doors connect to the outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Greatest step of a walk from the ground around the build to a floor of the room, in blocks: 0 or 1; null asks for
    /// no such walk. Steps of 1 include ladders.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_step: Option<u32>,
    /// Greatest share of doors in what stands beside the air of a room, from 0 to 1; null sets no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_door_share: Option<f64>,
    /// Least number of cells with standing room with which a space counts towards the greatest number of rooms; null
    /// takes that of a room.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counted_from: Option<u32>,
}

/// Check that there are enough doors, and that each has standing room on two opposite sides.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoorsLeadThrough {
    /// Least number of doors.
    #[serde(default = "one")]
    pub min_doors: u32,
    /// Least number of doors that part a space from another one or from the outside.
    #[serde(default, skip_serializing_if = "super::is_zero")]
    pub min_parting: u32,
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
        let most = self.max_rooms.map(|most| match self.counted_from {
            None => format!("at most {most} together with closed spaces as large as a room"),
            Some(cells) => format!("at most {most} together with closed spaces of {}", counted(cells, "cell of floor")),
        });
        let both: Vec<String> = [least, most].into_iter().flatten().collect();
        (!both.is_empty()).then(|| format!("; required {}", both.join(", and ")))
    }
}

impl Rule for EnclosedRooms {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            let mut required = match self.max_rooms {
                None => json!({ ">=": self.min_rooms }),
                Some(most) => json!({ "rooms": { ">=": self.min_rooms }, "rooms_and_closed": { "<=": most } }),
            };
            if let Some(step) = self.max_step {
                required["step"] = json!({ "<=": step });
            }
            if let Some(share) = self.max_door_share {
                required["doors"] = json!({ "share <=": share });
            }
            required
        });
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let spaces = around.spaces();
        let mut rooms = around.rooms_within(self.min_floor_cells, self.max_step);
        let reached = rooms.len();
        if let Some(most) = self.max_door_share {
            rooms.retain(|room| around.door_share(*room) <= most);
        }
        let closed = spaces.pieces.len() - 1 - rooms.len();
        // Closed spaces that nobody can enter count against a greatest number: doors alone would open them.
        let counted_from = self.counted_from.unwrap_or(self.min_floor_cells);
        let of_size = spaces.pieces[1..].iter().filter(|piece| piece.floor_cells >= counted_from).count();
        let is_not_too_many = self.max_rooms.is_none_or(|most| of_size <= most as usize);
        let holds = rooms.len() >= self.min_rooms as usize && is_not_too_many;
        let summary = subject.tell(|| {
            let way = match self.max_step {
                None => "",
                Some(0) => ", reached from the ground without a step",
                Some(_) => ", reached from the ground",
            };
            let apart = around.rooms(self.min_floor_cells).len() - reached;
            let apart = (apart > 0).then(|| format!(", {apart} of which cannot be reached so"));
            let of_doors = reached - rooms.len();
            let of_doors = (of_doors > 0).then(|| format!(", {of_doors} of which have too many doors for walls"));
            format!(
                "{} with a roof, a door and head room{way}; {}{}{}{}",
                counted(rooms.len(), "room"),
                counted(closed, "other enclosed space"),
                apart.unwrap_or_default(),
                of_doors.unwrap_or_default(),
                self.wanted().unwrap_or_default()
            )
        });
        // What explains a fault: spaces that are no rooms if rooms are missing, and those that count against the greatest
        // number if there are too many.
        let lacks_rooms = rooms.len() < self.min_rooms as usize;
        let is_room = |piece: usize| rooms.binary_search(&piece).is_ok();
        let is_of_size = |piece: usize| spaces.pieces[piece].floor_cells >= counted_from;
        let (shown, why) = match (lacks_rooms, is_not_too_many, of_size > rooms.len()) {
            (true, ..) => (Shown::NoRooms, "enclosed, but no room"),
            (false, false, true) if self.counted_from.is_some() => (Shown::ClosedOfSize, "space that counts as a room"),
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
        let closed_of_size = || (1..spaces.pieces.len()).filter(|piece| !is_room(*piece) && is_of_size(*piece)).count();
        let measured = subject.tell(|| match self.max_rooms {
            None => json!(rooms.len()),
            Some(_) => json!({ "rooms": rooms.len(), "closed": closed_of_size() }),
        });
        Finding::binary(holds, measured, required, summary).with_witnesses(witnesses, why)
    }
}

impl Rule for DoorsLeadThrough {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            let mut required = json!({ "doors": { ">=": self.min_doors }, "blocked": 0 });
            if self.min_parting > 0 {
                required["parting"] = json!({ ">=": self.min_parting });
            }
            required
        });
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let (terrain, spaces) = (&around.terrain, around.spaces());
        let doors = terrain.doors();
        let joined: Vec<_> = doors.iter().map(|door| (*door, terrain.joins(*door, spaces))).collect();
        let blocked: Vec<_> = joined.iter().filter(|(_, ends)| ends.is_none()).map(|(door, _)| *door).collect();
        let parts = |ends: &Option<[usize; 2]>| ends.is_some_and(|[one, other]| one != other);
        let parting = joined.iter().filter(|(_, ends)| parts(ends)).count();
        let holds =
            blocked.is_empty() && doors.len() >= self.min_doors as usize && parting >= self.min_parting as usize;
        let summary = subject.tell(|| {
            let required = counted(self.min_doors, "door");
            let found = match doors.len() {
                0 => "no door".to_owned(),
                all => of_all(blocked.len(), all, "door", "is blocked", "are blocked"),
            };
            if self.min_parting == 0 {
                return format!("{found}; required at least {required}");
            }
            let parts = format!("{} a space from another", agreeing(parting, "door parts", "doors part"));
            format!("{found}, and {parts}; required at least {required}, {} of them parting", self.min_parting)
        });
        let measured = subject.tell(|| {
            let mut measured = json!({ "doors": doors.len(), "blocked": blocked.len() });
            if self.min_parting > 0 {
                measured["parting"] = json!(parting);
            }
            measured
        });
        let idle = joined.iter().filter(|(_, ends)| ends.is_some() && !parts(ends)).map(|(door, _)| *door);
        let idle: Vec<_> = idle.filter(|_| parting < self.min_parting as usize).collect();
        Finding::binary(holds, measured, required, summary)
            .with_witnesses(blocked, "blocked")
            .with_witnesses(idle, "parts nothing")
    }
}
