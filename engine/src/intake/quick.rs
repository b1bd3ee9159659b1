//! Logs as programs write them, read byte by byte: whoever trains a model posts thousands of them a second.
//!
//! This reader explains nothing. It gives up at whatever is unusual: an unknown, missing or repeated member, a number that
//! is no plain integer of its range, a text with an escape or anything but printable ASCII, and what is not JSON. The
//! [shapes](super::tolerant) then read the same text again, with care.

#![expect(clippy::inline_always, reason = "a call for each number takes longer than reading it")]
use super::LogLimits;
use crate::voxel::block_log::{BlockLog, Event, Turn};
use crate::voxel::cell::{Cell, range};
use crate::voxel::palette::{MaterialId, Palette};

/// Most digits of a number that is read here, so that it cannot overflow.
const MAX_DIGITS: usize = 9;
/// Most rows or events of a turn that memory is reserved for before they are read.
const EXPECTED: usize = 1_024;

/// A row of the compact form; its material is an index of the palette that came with it.
#[derive(Debug, PartialEq)]
pub(super) struct Row {
    pub(super) index: usize,
    pub(super) cell: Cell,
    pub(super) material: Option<i64>,
}

/// An event whose material is still a name.
#[derive(Debug, Clone, Copy)]
pub(super) struct NamedEvent<'a> {
    /// Whether it places a block; otherwise it removes one.
    pub(super) is_place: bool,
    pub(super) cell: Cell,
    /// Printable ASCII. Never absent if the event places a block.
    pub(super) material: Option<&'a [u8]>,
}

/// Reads an array of at most `most` rows, or returns `None` if there are more, or if anything is unusual.
pub(super) fn quick_rows(json: &str, most: usize) -> Option<Vec<Row>> {
    let mut scanner = Scanner::new(json.as_bytes());
    let rows =
        scanner.rows(most, |index, cell, material| Some(Row { index, cell, material: material.map(i64::from) }))?;
    scanner.is_at_end().then_some(rows)
}

/// Reads an array of at most `most` events, or returns `None` if there are more, or if anything is unusual.
pub(super) fn quick_events(json: &str, most: usize) -> Option<Vec<NamedEvent<'_>>> {
    let mut scanner = Scanner::new(json.as_bytes());
    let events = scanner.events(most)?;
    scanner.is_at_end().then_some(events)
}

/// Gives each event the id of its material. A removal may name one too, which says nothing.
pub(super) fn with_materials(events: &[NamedEvent<'_>], mut intern: impl FnMut(&str) -> MaterialId) -> Turn {
    let mut last: (&[u8], MaterialId) = (&[], 0);
    let mut turn = Turn::with_capacity(events.len());
    for event in events {
        // Most blocks are of the kind of the one before.
        if let Some(name) = event.material.filter(|name| name.is_empty() || *name != last.0) {
            last = (name, intern(std::str::from_utf8(name).expect("ASCII")));
        }
        let cell = event.cell;
        turn.push(if event.is_place { Event::Place { cell, material: last.1 } } else { Event::Remove { cell } });
    }
    turn
}

/// Reader of JSON text. Each of its functions skips the space before a value and reads it, or returns `None` if it is
/// unusual. Unless a function says otherwise, the reader is then of no more use.
#[derive(Debug)]
pub struct Scanner<'a> {
    rest: &'a [u8],
}

impl<'a> Scanner<'a> {
    /// Begins to read a text.
    #[must_use]
    pub const fn new(text: &'a [u8]) -> Self {
        Self { rest: text }
    }

    /// Returns whether nothing but space is left.
    #[must_use]
    pub fn is_at_end(&self) -> bool {
        self.rest.iter().all(|byte| is_space(*byte))
    }

    /// Reads an object, each member's value by its name.
    #[inline]
    pub fn object(&mut self, mut member: impl FnMut(&mut Self, &'a [u8]) -> Option<()>) -> Option<()> {
        self.skip(b'{')?;
        if self.skip(b'}').is_some() {
            return Some(());
        }
        loop {
            let name = self.ascii()?;
            self.skip(b':')?;
            member(self, name)?;
            if self.skip(b',').is_none() {
                return self.skip(b'}');
            }
        }
    }

    /// Reads the turns of a log, each of events, or of a palette and rows. The log has the profile `published`.
    pub fn turns(&mut self, limits: LogLimits) -> Option<BlockLog> {
        let mut palette = Palette::new();
        let mut left = limits.max_events;
        let turns = self.array(Vec::new(), limits.max_turns, |scanner, _| {
            let turn = scanner.turn(&mut palette, left, limits)?;
            left -= turn.len();
            Some(turn)
        })?;
        Some(BlockLog { palette, turns, ..BlockLog::default() })
    }

    fn turn(&mut self, palette: &mut Palette, most: usize, limits: LogLimits) -> Option<Turn> {
        let mut names: Option<Vec<MaterialId>> = None;
        let mut turn = None;
        let is_short = |name: &[u8]| name.len() <= limits.max_material_chars;
        self.object(|scanner, member| {
            match member {
                b"palette" if names.is_none() && turn.is_none() => {
                    names = Some(scanner.array(Vec::new(), limits.max_materials, |scanner, _| {
                        scanner.text().filter(|name| is_short(name.as_bytes())).map(|name| palette.intern(name))
                    })?);
                }
                b"rows" if turn.is_none() => {
                    let names = names.as_ref()?;
                    let event = |_, cell, material: Option<u32>| match material {
                        Some(i) => names.get(i as usize).map(|&material| Event::Place { cell, material }),
                        None => Some(Event::Remove { cell }),
                    };
                    turn = Some(scanner.rows(most, event)?);
                }
                b"events" if names.is_none() && turn.is_none() => {
                    let events = scanner.events(most)?;
                    if !events.iter().filter_map(|event| event.material).all(is_short) {
                        return None;
                    }
                    turn = Some(with_materials(&events, |name| palette.intern(name)));
                }
                _ => return None,
            }
            Some(())
        })?;
        turn.filter(|_| palette.len() <= limits.max_materials)
    }

    /// Reads an array of at most `most` rows, each given by its index, its cell and its entry in the palette.
    fn rows<T>(&mut self, most: usize, mut row: impl FnMut(usize, Cell, Option<u32>) -> Option<T>) -> Option<Vec<T>> {
        // The shortest row, with its comma, has eight bytes.
        let rows = Vec::with_capacity(most.min(self.rest.len() / 8 + 1).min(EXPECTED));
        self.array(rows, most, |scanner, index| {
            let (cell, material) = scanner.row()?;
            row(index, cell, material)
        })
    }

    /// Reads an array of at most `most` events.
    fn events(&mut self, most: usize) -> Option<Vec<NamedEvent<'a>>> {
        // The shortest event, with its comma, has 38 bytes.
        let events = Vec::with_capacity(most.min(self.rest.len() / 38 + 1).min(EXPECTED));
        self.array(events, most, |scanner, _| scanner.event())
    }

    /// Reads an array of at most `most` elements, each by its index.
    fn array<T>(
        &mut self,
        mut items: Vec<T>,
        most: usize,
        mut item: impl FnMut(&mut Self, usize) -> Option<T>,
    ) -> Option<Vec<T>> {
        self.skip(b'[')?;
        if self.skip(b']').is_none() {
            loop {
                if items.len() == most {
                    return None;
                }
                let read = item(self, items.len())?;
                items.push(read);
                if self.skip(b',').is_none() {
                    break;
                }
            }
            self.skip(b']')?;
        }
        Some(items)
    }

    #[inline(always)]
    fn row(&mut self) -> Option<(Cell, Option<u32>)> {
        self.skip(b'[')?;
        let x = self.coordinate(0)?;
        self.skip(b',')?;
        let y = self.coordinate(1)?;
        self.skip(b',')?;
        let z = self.coordinate(2)?;
        let material = match self.skip(b',') {
            Some(()) => Some(u32::try_from(self.integer()?).ok()?),
            None => None,
        };
        self.skip(b']')?;
        Some((Cell::new(x, y, z), material))
    }

    #[inline]
    fn event(&mut self) -> Option<NamedEvent<'a>> {
        let (mut is_place, mut at, mut material, mut has_material) = (None, [None; 3], None, false);
        self.object(|scanner, key| {
            match key {
                b"x" if at[0].is_none() => at[0] = Some(scanner.coordinate(0)?),
                b"y" if at[1].is_none() => at[1] = Some(scanner.coordinate(1)?),
                b"z" if at[2].is_none() => at[2] = Some(scanner.coordinate(2)?),
                b"action" if is_place.is_none() => {
                    is_place = match scanner.ascii()? {
                        b"place" => Some(true),
                        b"remove" => Some(false),
                        _ => return None,
                    }
                }
                b"material" if !has_material => {
                    has_material = true;
                    material = if scanner.null().is_some() { None } else { Some(scanner.ascii()?) };
                }
                _ => return None,
            }
            Some(())
        })?;
        let is_place = is_place?;
        if is_place && material.is_none() {
            return None;
        }
        Some(NamedEvent { is_place, cell: Cell::new(at[0]?, at[1]?, at[2]?), material })
    }

    #[inline(always)]
    fn coordinate(&mut self, axis: usize) -> Option<i32> {
        self.integer().filter(|number| range(axis).contains(number))
    }

    /// Reads an integer of at most nine digits. If none comes next, something else may be read instead.
    #[inline(always)]
    pub fn integer(&mut self) -> Option<i32> {
        let mut ahead = Self { rest: self.rest };
        let number = ahead.digits()?;
        self.rest = ahead.rest;
        Some(number)
    }

    #[inline(always)]
    fn digits(&mut self) -> Option<i32> {
        let is_negative = self.skip(b'-').is_some();
        let mut number = 0;
        for (digits, byte) in self.rest.iter().enumerate() {
            let digit = byte.wrapping_sub(b'0');
            if digit > 9 {
                let is_plain = digits > 0 && (digits == 1 || self.rest[0] != b'0');
                self.rest = &self.rest[digits..];
                return is_plain.then_some(if is_negative { -number } else { number });
            }
            if digits == MAX_DIGITS {
                break;
            }
            number = number * 10 + i32::from(digit);
        }
        None
    }

    /// Reads `null`. If it does not come next, something else may be read instead.
    fn null(&mut self) -> Option<()> {
        let mut ahead = Self { rest: self.rest };
        ahead.skip(b'n')?;
        self.rest = ahead.rest.strip_prefix(b"ull")?;
        Some(())
    }

    /// Reads a string of printable ASCII without escapes.
    pub fn text(&mut self) -> Option<&'a str> {
        self.ascii().map(|text| std::str::from_utf8(text).expect("ASCII"))
    }

    #[inline]
    fn ascii(&mut self) -> Option<&'a [u8]> {
        self.skip(b'"')?;
        let end = self.rest.iter().position(|byte| matches!(byte, b'"' | b'\\' | ..b' ' | 0x7f..))?;
        let (text, rest) = self.rest.split_at(end);
        self.rest = rest.strip_prefix(b"\"")?;
        Some(text)
    }

    /// Skips space and then this byte, if it comes next. Skips the space in any case.
    #[inline(always)]
    fn skip(&mut self, byte: u8) -> Option<()> {
        while let Some((first, rest)) = self.rest.split_first() {
            if *first == byte {
                self.rest = rest;
                return Some(());
            }
            if !is_space(*first) {
                return None;
            }
            self.rest = rest;
        }
        None
    }
}

/// Returns whether a byte is space between the parts of JSON.
const fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intake::{Faults, read_turns};
    use proptest::prelude::*;

    const LIMITS: LogLimits = LogLimits { max_turns: 3, max_events: 5, max_materials: 3, max_material_chars: 8 };

    /// Reads turns in one pass.
    fn quick(text: &str) -> Option<BlockLog> {
        let mut scanner = Scanner::new(text.as_bytes());
        scanner.turns(LIMITS).filter(|_| scanner.is_at_end())
    }

    /// Returns what tells two logs apart: the events, and the names in the order of their ids.
    fn parts(log: BlockLog) -> (Vec<Turn>, Vec<String>) {
        (log.turns, log.palette.names().map(str::to_owned).collect())
    }

    #[test]
    fn logs_as_programs_write_them_are_read_in_one_pass() {
        for (text, events) in [
            ("[]", 0),
            (r#" [ { "palette" : [ "stone", "stone" ], "rows" : [ [ 0, -1, 2, 1 ], [0,0,0] ] } ] "#, 2),
            (r#"[{"events":[]},{"palette":[],"rows":[]}]"#, 0),
            (r#"[{"events":[{"action":"place","x":0,"y":0,"z":0,"material":"oak log"}]}]"#, 1),
        ] {
            assert_eq!(quick(text).map(|log| log.event_count()), Some(events), "{text}");
        }
    }

    #[test]
    fn what_is_unusual_or_no_json_is_not() {
        for text in [
            "",
            "[",
            "[]]",
            "[],",
            "[]\u{c}",
            "[{}]",
            r#"[{"events":[]},]"#,
            r#"[{"events":[],"events":[]}]"#,
            r#"[{"events":[],"palette":[]}]"#,
            r#"[{"rows":[[0,0,0]],"palette":[]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,0,1]]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,01,0]]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,-,0]]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,- 1,0]]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,1,-1]]}]"#,
            r#"[{"palette":["a"],"rows":[[0,0,1,0],]}]"#,
            r#"[{"palette":["123456789"],"rows":[]}]"#,
            r#"[{"events":[{"action":"place","x":0,"y":0,"z":0,"material":n"dirt"}]}]"#,
            r#"[{"events":[{"action":"place","x":0,"y":0,"z":0,"material":nul}]}]"#,
            r#"[{"events":[{"action":"remove","x":0,"y":0,"z":00}]}]"#,
            r#"[{"palette":["1","2","3","4"],"rows":[]}]"#,
            r#"[{"palette":["1","2"],"rows":[]},{"palette":["3","4"],"rows":[]}]"#,
            r#"[{"events":[]},{"events":[]},{"events":[]},{"events":[]}]"#,
            r#"[{"palette":[],"rows":[[0,0,0],[0,0,0],[0,0,0]]},{"palette":[],"rows":[[0,0,0],[0,0,0],[0,0,0]]}]"#,
        ] {
            assert!(quick(text).is_none(), "{text}");
        }
    }

    proptest! {
        /// What is read in one pass is what is read with care, and has no fault.
        #[test]
        fn one_pass_reads_what_care_reads(
            turns in prop::collection::vec(
                prop_oneof![
                    (
                        "(\"(stone|a b|dirt|é|0123456789)\",?){0,3}",
                        "(\\[ ?-?[0-9]{1,2},-?[0-9],[0-9](,[0-3])? ?\\],?){0,3}",
                        "(,\"rows\":\\[\\])?",
                    ).prop_map(|(palette, rows, more)| format!("{{\"palette\":[{palette}],\"rows\":[{rows}]{more}}}")),
                    "(\\{\"action\":\"(place|remove)\",\"x\":[0-9],\"y\":0,\"z\":-?[0-9](,\"material\":(\"(dirt|x)\"|null))?\\},?){0,3}"
                        .prop_map(|events| format!("{{ \"events\":\n[{events}]}}")),
                ],
                0..5,
            ),
        ) {
            let text = format!("[{}]", turns.join(","));
            let Some(log) = quick(&text) else { return Ok(()) };
            let mut faults = Faults::new();
            let with_care = read_turns(text.as_bytes(), LIMITS, &mut faults);
            prop_assert!(faults.is_empty(), "{:?}", faults.list());
            prop_assert_eq!(Some(parts(log)), with_care.ok().flatten().map(parts));
        }
    }
}
