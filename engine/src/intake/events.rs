//! The plain form of a turn: an array of events.

use serde::de::{IgnoredAny, MapAccess, SeqAccess};
use serde_json::value::RawValue;

use super::Reader;
use super::faults::Faults;
use super::key::Key;
use super::quick::{NamedEvent, quick_events, with_materials};
use super::schema::EventAction;
use super::tolerant::{Integer, OrNull, Read, Scalar, Shape, Text, read_document};
use crate::voxel::block_log::{Event, Turn};
use crate::voxel::cell::{Cell, range};
use crate::voxel::palette::MaterialId;

/// Reads an array of events from its JSON, at the current location. Returns `None` if it is faulty.
pub(super) fn read_events(json: &RawValue, reader: &mut Reader<'_>) -> Option<Turn> {
    let max_chars = reader.limits.max_material_chars;
    let fits = |event: &NamedEvent<'_>| event.material.is_none_or(|name| name.len() <= max_chars);
    let quick = quick_events(json.get(), reader.events_left()).filter(|events| events.iter().all(fits));
    let Some(events) = quick else { return read_with_care(json.get(), reader) };
    reader.events += events.len();
    Some(with_materials(&events, |name| reader.intern(name)))
}

fn read_with_care(json: &str, reader: &mut Reader<'_>) -> Option<Turn> {
    let depth = reader.faults.depth();
    let turn = read_document(json.as_bytes(), EventsShape { reader: &mut *reader });
    turn.unwrap_or_else(|error| reader.cut_short(depth, &error))
}

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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::intake::LogLimits;

    const LIMITS: LogLimits = LogLimits { max_turns: 2, max_events: 4, max_materials: 2, max_material_chars: 10 };

    /// Returns the events with the names of their materials, and the faults that a reader finds.
    fn found(read: impl FnOnce(&mut Reader<'_>) -> Option<Turn>) -> (Option<Turn>, Vec<String>, Vec<String>) {
        let mut faults = Faults::new();
        let mut reader = Reader::new(&mut faults, LIMITS);
        let turn = read(&mut reader);
        reader.check_totals();
        let names = reader.palette.names().map(ToOwned::to_owned).collect();
        (turn, names, faults.list().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn plain_events_are_read_quickly() {
        for (text, count) in [
            ("[]", 0),
            (r#"[{"action":"place","x":1,"y":-2,"z":3,"material":"stone"}]"#, 1),
            (
                r#"[{"material": "", "z": 3, "y": 2, "x": 1, "action": "place"}, {"action": "remove", "x": 1, "y": 2, "z": 3, "material": null}]"#,
                2,
            ),
            ("[\n\t{\"x\" : -0, \"y\":2047,\r\n\"z\":30000000,\"action\":\"remove\"}\n]\n", 1),
        ] {
            assert_eq!(quick_events(text, 4).map(|events| events.len()), Some(count), "{text}");
        }
    }

    proptest! {
        #[test]
        fn events_are_the_same_however_they_are_read(
            events in prop::collection::vec(
                prop::collection::vec(
                    (
                        prop::sample::select(vec!["action", "x", "y", "z", "material", "x", "colour"]),
                        prop_oneof![
                            "-?[0-9]", "[1-9][0-9]{3,9}", "\"(place|remove|stone|oak_log|dirt|)\"",
                            "null|1.0|2e1|1e999|\"a\\\\u0062\"|\"\u{e4}\"|\"abcdefghijkl\"|\"\u{7f}\"|\\[\\]|\\{\\}"
                        ],
                        "[ \n]?",
                    ),
                    0..7,
                ),
                0..6,
            ),
            whole in any::<bool>(),
        ) {
            let event = |members: &Vec<(&str, String, String)>| {
                let members: Vec<String> = members.iter().map(|(k, v, space)| format!("{space}\"{k}\"{space}:{space}{v}{space}")).collect();
                // Half of the texts begin like good events, so that some of them are.
                let good = r#""action":"place","y":1,"z":2,"material":"stone","x":0"#;
                format!("{{{}}}", if whole { good.to_owned() } else { members.join(",") })
            };
            let mut all: Vec<String> = events.iter().map(event).collect();
            if whole && let Some(members) = events.first() {
                let odd: Vec<String> = members.iter().map(|(k, v, _)| format!("\"{k}\":{v}")).collect();
                all.push(format!("{{{}}}", odd.join(", ")));
            }
            let text = format!("[{}]", all.join(","));
            let Ok(json) = serde_json::from_str::<&RawValue>(&text) else { return Ok(()) };
            prop_assert_eq!(
                found(|reader| read_events(json, reader)),
                found(|reader| read_with_care(json.get(), reader))
            );
        }
    }
}
