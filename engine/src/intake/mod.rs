//! Reads block logs from JSON, in the plain or the compact form, and reports all faults at once.
//!
//! A turn is `{"events": [{"action": "place", "x": 0, "y": -1, "z": 0, "material": "stone"}, …]}` or, compactly,
//! `{"palette": ["stone"], "rows": [[0, -1, 0, 0], …]}`, where a row `[x, y, z, i]` places a block of `palette[i]` and
//! a row `[x, y, z]` removes one.

use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess};
use serde_json::value::RawValue;

use crate::text::agreeing;
use crate::voxel::block_log::{BlockLog, Event, Turn};
use crate::voxel::palette::MaterialId;
use tolerant::{OrNull, Read, Shape, Texts, Verbatim};

/// Reads the value of the member whose key was just read; its faults get the location of that member. If the text is
/// not JSON, the macro returns early and keeps the current location, so that the caller can report it.
macro_rules! member {
    ($members:expr, $reader:expr, $key:expr, $shape:expr) => {{
        $reader.faults.enter_name($key);
        let value = $members.next_value_seed(Read(OrNull($shape)))?;
        $reader.faults.leave();
        // `null` is equivalent to an absent member.
        value.flatten()
    }};
}

/// Does the same as `member!`, but hands the raw JSON of the value to a function.
macro_rules! json_member {
    ($members:expr, $reader:expr, $key:expr, $read:expr) => {{
        $reader.faults.enter_name($key);
        let json = $members.next_value::<&RawValue>()?;
        let value = (json.get() != "null").then(|| $read(json, $reader));
        $reader.faults.leave();
        value
    }};
}

/// Reads the elements of an array one by one with the same shape.
macro_rules! array_of {
    ($elements:ident, $reader:ident, $shape:expr, |$i:ident, $item:ident| $keep:block) => {{
        let mut $i = 0usize;
        loop {
            $reader.faults.enter_index($i);
            let item = $elements.next_element_seed(Read($shape))?;
            $reader.faults.leave();
            let Some($item) = item else { break };
            $keep
            $i += 1;
        }
    }};
}

pub mod code;
mod events;
pub mod faults;
mod file;
mod key;
pub mod not_json;
pub mod quick;
mod reader;
mod rows;
pub mod schema;
pub mod stored;
pub mod surrogates;
pub mod text;
pub mod tolerant;

pub use faults::{Fault, Faults};

use code::{SentLog, TurnCode, TurnStructure};
use events::{EventsShape, read_events};
use file::CornerShape;
use quick::Row;
use reader::Reader;
use rows::{PaletteShape, read_rows};

/// Limits on the size of a log. Served at `/v1/limits`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogLimits {
    /// Maximum number of turns in a log.
    pub max_turns: usize,
    /// Maximum number of events over all turns.
    pub max_events: usize,
    /// Maximum number of distinct material names.
    pub max_materials: usize,
    /// Maximum length of a material name, in characters.
    pub max_material_chars: usize,
}

/// The shape of the array of turns of a log.
#[derive(Debug)]
pub struct Turns<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Limits on the log.
    pub limits: LogLimits,
}

impl<'de> Shape<'de> for Turns<'_> {
    type Out = SentLog;

    fn wanted(&self) -> &'static str {
        "an array of turns"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<SentLog>, A::Error> {
        let mut reader = Reader::new(self.faults, self.limits);
        let mut turns = Vec::new();
        loop {
            reader.faults.enter_index(turns.len());
            let turn = elements.next_element_seed(Read(TurnShape { reader: &mut reader, turn: turns.len() }))?;
            reader.faults.leave();
            let Some(turn) = turn else { break };
            turns.push(turn.unwrap_or_default());
            if turns.len() > reader.limits.max_turns {
                reader.faults.add(format!("more than {} turns", reader.limits.max_turns));
                while elements.next_element::<IgnoredAny>()?.is_some() {}
                return Ok(None);
            }
        }
        reader.check_totals();
        Ok(Some(SentLog {
            log: BlockLog { palette: reader.palette, turns, ..BlockLog::default() },
            codes: reader.codes,
            structures: reader.structures,
        }))
    }
}

/// The shape of the events of one turn.
#[derive(Debug)]
pub struct TurnEvents<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Limits on the log.
    pub limits: LogLimits,
}

impl<'de> Shape<'de> for TurnEvents<'_> {
    type Out = BlockLog;

    fn wanted(&self) -> &'static str {
        "an array of events"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn array<A: SeqAccess<'de>>(self, elements: A) -> Result<Option<BlockLog>, A::Error> {
        let mut reader = Reader::new(self.faults, self.limits);
        let turn = EventsShape { reader: &mut reader }.array(elements)?;
        reader.check_totals();
        let palette = reader.palette;
        Ok(turn.map(|turn| BlockLog { palette, turns: vec![turn], ..BlockLog::default() }))
    }
}

/// Greatest number of files of action code in a turn.
pub const MAX_FILES: usize = 64;

const UNKNOWN: &str = "unknown field; a turn has events, or palette and rows, or action_code, or structure";
const NONE_OF: &str =
    "events, rows, action_code and structure are missing or null; write an empty turn as {\"events\": []}";
const ONE_OF: &str = "give either events, or palette and rows, or action_code, or structure";

struct TurnShape<'r, 'f> {
    reader: &'r mut Reader<'f>,
    turn: usize,
}

impl<'de> Shape<'de> for TurnShape<'_, '_> {
    type Out = Turn;

    fn wanted(&self) -> &'static str {
        "a turn: an object with \"events\", with \"palette\" and \"rows\", with \"action_code\", or with \"structure\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<Turn>, A::Error> {
        let (reader, turn) = (self.reader, self.turn);
        let (mut events, mut palette, mut rows, mut code) = (None, None, None, None);
        let (mut structure, mut corner) = (None, None);
        while let Some(key) = members.next_key::<String>()? {
            match key.as_str() {
                "events" if events.is_none() => {
                    events = json_member!(members, reader, "events", read_events);
                }
                "palette" if palette.is_none() => {
                    palette = member!(members, reader, "palette", PaletteShape { reader: &mut *reader });
                }
                "rows" if rows.is_none() => {
                    rows = json_member!(members, reader, "rows", read_rows);
                }
                "action_code" if code.is_none() => {
                    code =
                        member!(members, reader, "action_code", Texts { faults: &mut *reader.faults, most: MAX_FILES });
                }
                "structure" if structure.is_none() => {
                    structure = member!(members, reader, "structure", Verbatim { faults: &mut *reader.faults });
                }
                "corner" if corner.is_none() => {
                    corner = member!(members, reader, "corner", CornerShape { faults: &mut *reader.faults });
                }
                known @ ("events" | "palette" | "rows" | "action_code" | "structure" | "corner") => {
                    reader.faults.add_at(known, "given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                unknown => {
                    reader.faults.add_at(unknown, UNKNOWN);
                    members.next_value::<IgnoredAny>()?;
                }
            }
        }
        let has_events = events.is_some() || palette.is_some() || rows.is_some();
        if let Some(structure) = structure {
            if has_events || code.is_some() {
                reader.faults.add(ONE_OF);
                return Ok(None);
            }
            let corner = corner.flatten();
            reader.structures.extend(structure.map(|base64| TurnStructure { turn, base64, corner }));
            return Ok(Some(Turn::new()));
        }
        if corner.is_some() {
            reader.faults.add_at("corner", "only a structure has a corner");
            return Ok(None);
        }
        if let Some(code) = code {
            if has_events {
                reader.faults.add(ONE_OF);
                return Ok(None);
            }
            reader.codes.extend(code.map(|files| TurnCode { turn, files }));
            return Ok(Some(Turn::new()));
        }
        Ok(match (events, palette, rows) {
            (Some(events), None, None) => events,
            (None, None, Some(Some(rows))) if rows.iter().any(|row| row.material.is_some()) => {
                reader.faults.add_at("palette", "missing; the last number of a row is an index of the palette");
                None
            }
            (None, palette, Some(rows)) => rows.and_then(|rows| {
                let names = palette.unwrap_or_else(|| Some(Vec::new()));
                names.map(|names| {
                    reader.faults.enter_key("rows");
                    let turn = resolve_rows(reader, rows, &names);
                    reader.faults.leave();
                    turn
                })
            }),
            (None, Some(_), None) => {
                reader.faults.add_at("rows", "missing");
                None
            }
            (None, None, None) => {
                reader.faults.add(NONE_OF);
                None
            }
            (Some(_), _, _) => {
                reader.faults.add("give either events, or palette and rows");
                None
            }
        })
    }
}

/// Resolves the palette indices of `rows` to ids in the palette of the log. `names` holds the id of each entry of the
/// palette that came with the rows.
fn resolve_rows(reader: &mut Reader<'_>, rows: Vec<Row>, names: &[MaterialId]) -> Turn {
    let mut turn = Turn::with_capacity(rows.len());
    for Row { index, cell, material } in rows {
        match material.map(|i| usize::try_from(i).ok().and_then(|i| names.get(i)).ok_or(i)) {
            None => turn.push(Event::Remove { cell }),
            Some(Ok(&material)) => turn.push(Event::Place { cell, material }),
            Some(Err(i)) => {
                reader.faults.enter_index(index);
                reader.faults.enter_index(3);
                reader.faults.add(format!(
                    "{i} is not an index of the palette, which has {}",
                    agreeing(names.len(), "entry", "entries")
                ));
                reader.faults.leave();
                reader.faults.leave();
            }
        }
    }
    turn
}

/// Reads the array of turns of a log from a whole JSON document. Action code is a fault, because it is not run here.
///
/// # Errors
/// Returns an error if the text is not JSON. Faults of well-formed JSON go to `faults`.
pub fn read_turns(text: &[u8], limits: LogLimits, faults: &mut Faults) -> Result<Option<BlockLog>, serde_json::Error> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let sent = Read(Turns { faults, limits }).deserialize(&mut deserializer)?;
    deserializer.end()?;
    let Some(SentLog { log, codes, structures }) = sent else { return Ok(None) };
    if !structures.is_empty() {
        faults.add("structure files are not supported here");
    }
    if !codes.is_empty() {
        faults.add("action code is not supported here");
    }
    Ok(Some(log))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LogLimits = LogLimits { max_turns: 2, max_events: 5, max_materials: 2, max_material_chars: 10 };

    fn faults_of(text: &str) -> Vec<String> {
        let mut faults = Faults::new();
        read_turns(text.as_bytes(), LIMITS, &mut faults).unwrap();
        faults.list().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn both_forms_have_the_same_canonical_bytes() {
        let mut faults = Faults::new();
        let plain = br#"[{"events":[{"action":"place","x":1,"y":2,"z":3,"material":"stone"},{"action":"remove","x":1,"y":2,"z":3}]}]"#;
        let compact = br#"[{"palette":["dirt","stone"],"rows":[[1,2,3,1],[1,2,3]]}]"#;
        let plain = read_turns(plain, LIMITS, &mut faults).unwrap().unwrap();
        let compact = read_turns(compact, LIMITS, &mut faults).unwrap().unwrap();
        assert!(faults.is_empty());
        assert_eq!(plain.canonical_json(), compact.canonical_json());
        assert_eq!(plain.canonical_json(), br#"{"palette":["stone"],"turns":[[[1,2,3,0],[1,2,3]]]}"#);
    }

    #[test]
    fn every_fault_is_told_with_its_place() {
        let faults = faults_of(
            r#"[{"events":[{"action":"paint","x":1.5,"y":9999,"material":7,"colour":"red"}, 3]},
                {"palette":["stone"],"rows":[[1,2,3,1],[1,2],[0,0,"a"]], "extra": {}}]"#,
        );
        assert_eq!(
            faults,
            [
                "/0/events/0/action: expected \"place\" or \"remove\", found \"paint\"",
                "/0/events/0/x: 1.5 is not an integer",
                "/0/events/0/y: 9999 is out of range: -2048 to 2047",
                "/0/events/0/material: expected a string, found 7",
                "/0/events/0/colour: unknown field; an event has action, x, y, z and material",
                "/0/events/0/z: missing",
                "/0/events/1: expected an event: an object with \"action\", \"x\", \"y\", \"z\" and, to place a block, \"material\", found 3",
                "/1/rows/1: expected 3 or 4 numbers, found 2 values",
                "/1/rows/2/2: expected an integer, found \"a\"",
                "/1/extra: unknown field; a turn has events, or palette and rows, or action_code, or structure",
                "/1/rows/0/3: 1 is not an index of the palette, which has 1 entry",
            ]
        );
        let none =
            "events, rows, action_code and structure are missing or null; write an empty turn as {\"events\": []}";
        assert_eq!(faults_of(r#"[{"action_code": null}, {}]"#), [format!("/0: {none}"), format!("/1: {none}")]);
    }

    #[test]
    fn a_comma_too_many_is_told() {
        for text in [
            r#"[{"rows":[[0,0,0],]}]"#,
            "[{\"rows\":[[0,0,0],\n ]}]",
            r#"[{"rows":[[0,0,0,]]}]"#,
            r#"[{"events":[{"action":"remove","x":0,"y":0,"z":0,}]}]"#,
            r#"[{"events":[],}]"#,
            r#"[{"events":[]},]"#,
        ] {
            let error = read_turns(text.as_bytes(), LIMITS, &mut Faults::new()).unwrap_err();
            let told = not_json::why_not_json(text.as_bytes(), &error);
            assert!(told.contains("comma"), "{text}: {told}");
        }
    }

    #[test]
    fn an_empty_turn_is_a_turn_and_a_missing_one_is_a_fault() {
        assert!(faults_of(r#"[{"events":[]}]"#).is_empty());
        assert_eq!(faults_of("[{}]").len(), 1);
    }

    #[test]
    fn one_event_too_many_is_counted_not_kept() {
        let text = format!(r#"[{{"palette":["stone"],"rows":[{}]}}]"#, ["[0,0,0,0]"; 9].join(","));
        assert_eq!(faults_of(&text), ["9 events; at most 5 are allowed"]);
    }
}
