//! The plain form of a turn: an array of events.

use std::ops::RangeInclusive;

use serde::de::{IgnoredAny, MapAccess, SeqAccess};

use super::Reader;
use super::faults::Faults;
use super::key::Key;
use super::schema::EventAction;
use super::tolerant::{Integer, OrNull, Read, Scalar, Shape, Text};
use crate::voxel::block_log::{Event, Turn};
use crate::voxel::cell::{Cell, MAX_HORIZONTAL, MAX_Y, MIN_Y};
use crate::voxel::palette::MaterialId;

pub(super) struct EventsShape<'r, 'f> {
    pub(super) reader: &'r mut Reader<'f>,
}

impl<'de> Shape<'de> for EventsShape<'_, '_> {
    type Out = Turn;

    fn wanted(&self) -> &'static str {
        "an array of events"
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Turn>, A::Error> {
        let reader = self.reader;
        let mut turn = Turn::new();
        array_of!(elements, reader, EventShape { reader: &mut *reader }, |i, event| {
            if reader.count_event() {
                turn.extend(event);
            }
        });
        Ok(Some(turn))
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];
const KEYS: [&str; 5] = ["action", "x", "y", "z", "material"];

struct EventShape<'r, 'f> {
    reader: &'r mut Reader<'f>,
}

impl<'de> Shape<'de> for EventShape<'_, '_> {
    type Out = Event;

    fn wanted(&self) -> &'static str {
        "an event: an object with \"action\", \"x\", \"y\", \"z\" and, to place a block, \"material\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<Event>, A::Error> {
        let reader = self.reader;
        let mut action = None;
        let mut at: [Option<Option<i64>>; 3] = [None; 3];
        let mut material = None;
        while let Some(key) = members.next_key_seed(Key(&KEYS))? {
            match &*key {
                "action" if action.is_none() => {
                    action = member!(members, reader, "action", ActionShape { faults: &mut *reader.faults });
                }
                "material" if material.is_none() => {
                    material = member!(members, reader, "material", MaterialShape { reader: &mut *reader });
                }
                axis @ ("x" | "y" | "z") if at[axis_index(axis)].is_none() => {
                    let i = axis_index(axis);
                    at[i] = member!(members, reader, AXES[i], coordinate(i, reader.faults));
                }
                "action" | "material" | "x" | "y" | "z" => {
                    reader.faults.add_at(&key, "given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                unknown => {
                    reader.faults.add_at(unknown, "unknown field; an event has action, x, y, z and material");
                    members.next_value::<IgnoredAny>()?;
                }
            }
        }
        for (axis, value) in AXES.iter().zip(&at) {
            if value.is_none() {
                reader.faults.add_at(axis, "missing");
            }
        }
        if action.is_none() {
            reader.faults.add_at("action", "missing: \"place\" or \"remove\"");
        }
        if action == Some(Some(EventAction::Place)) && material.is_none() {
            reader.faults.add_at("material", "missing: an event that places a block needs a material");
        }
        let cell = cell_of(at.map(Option::flatten));
        Ok(match (action.flatten(), cell, material.flatten()) {
            (Some(EventAction::Place), Some(cell), Some(material)) => Some(Event::Place { cell, material }),
            (Some(EventAction::Remove), Some(cell), _) => Some(Event::Remove { cell }),
            _ => None,
        })
    }
}

fn axis_index(axis: &str) -> usize {
    match axis {
        "x" => 0,
        "y" => 1,
        _ => 2,
    }
}

pub(super) fn cell_of(at: [Option<i64>; 3]) -> Option<Cell> {
    let [x, y, z] = at;
    Some(Cell::new(i32::try_from(x?).ok()?, i32::try_from(y?).ok()?, i32::try_from(z?).ok()?))
}

/// Returns the supported range of a coordinate on axis 0 (x), 1 (y) or 2 (z).
pub(super) const fn range(axis: usize) -> RangeInclusive<i32> {
    if axis == 1 { MIN_Y..=MAX_Y } else { -MAX_HORIZONTAL..=MAX_HORIZONTAL }
}

/// Returns the shape of a coordinate on axis 0 (x), 1 (y) or 2 (z), within the supported range.
pub(super) fn coordinate(axis: usize, faults: &mut Faults) -> Integer<'_> {
    let range = range(axis);
    Integer { faults, min: i64::from(*range.start()), max: i64::from(*range.end()) }
}

struct ActionShape<'f> {
    faults: &'f mut Faults,
}

impl Shape<'_> for ActionShape<'_> {
    type Out = EventAction;

    fn wanted(&self) -> &'static str {
        "\"place\" or \"remove\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<EventAction> {
        match value {
            Scalar::Text("place") => Some(EventAction::Place),
            Scalar::Text("remove") => Some(EventAction::Remove),
            other => {
                self.faults.add(format!("expected \"place\" or \"remove\", found {other}"));
                None
            }
        }
    }
}

pub(super) struct MaterialShape<'r, 'f> {
    pub(super) reader: &'r mut Reader<'f>,
}

impl Shape<'_> for MaterialShape<'_, '_> {
    type Out = MaterialId;

    fn wanted(&self) -> &'static str {
        "a material name"
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<MaterialId> {
        if let Scalar::Text(name) = value
            && let Some(id) = self.reader.palette.get(name)
        {
            return Some(id);
        }
        let max_chars = self.reader.limits.max_material_chars;
        let name = Text { faults: self.reader.faults, min_chars: 0, max_chars }.scalar(value)?;
        Some(self.reader.intern(&name))
    }
}
