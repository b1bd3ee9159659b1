//! Rows and events as programs write them, read byte by byte: a log is mostly these, and whoever trains a model posts
//! thousands of logs a second.
//!
//! This reader explains nothing. It gives up at whatever is unusual: an unknown, missing or repeated member, a number that
//! is no plain integer of its range, a text with an escape or anything but printable ASCII. The shapes of rows and events
//! then read the same text again, with care.

use crate::voxel::cell::{Cell, range};

/// Most digits of a number that is read here, so that it cannot overflow.
const MAX_DIGITS: usize = 9;

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

/// Reads an array of at most `most` rows from JSON that is known to be valid, or returns `None` if there are more, or if
/// anything is unusual.
pub(super) fn quick_rows(json: &str, most: usize) -> Option<Vec<Row>> {
    // The shortest row, with its comma, has eight bytes.
    let rows = Vec::with_capacity(most.min(json.len() / 8 + 1));
    Scanner { rest: json.as_bytes() }.array(rows, most, Scanner::row)
}

/// Reads an array of at most `most` events from JSON that is known to be valid, or returns `None` if there are more, or if
/// anything is unusual.
pub(super) fn quick_events(json: &str, most: usize) -> Option<Vec<NamedEvent<'_>>> {
    // The shortest event, with its comma, has 38 bytes.
    let events = Vec::with_capacity(most.min(json.len() / 38 + 1));
    Scanner { rest: json.as_bytes() }.array(events, most, |scanner, _| scanner.event())
}

struct Scanner<'a> {
    rest: &'a [u8],
}

impl<'a> Scanner<'a> {
    /// Reads the whole text as an array, each element by its index.
    fn array<T>(
        mut self,
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
                let read = item(&mut self, items.len())?;
                items.push(read);
                if self.skip(b',').is_none() {
                    break;
                }
            }
            self.skip(b']')?;
        }
        self.rest.iter().all(u8::is_ascii_whitespace).then_some(items)
    }

    #[inline]
    fn row(&mut self, index: usize) -> Option<Row> {
        self.skip(b'[')?;
        let x = self.coordinate(0)?;
        self.skip(b',')?;
        let y = self.coordinate(1)?;
        self.skip(b',')?;
        let z = self.coordinate(2)?;
        let material = match self.skip(b',') {
            Some(()) => Some(i64::from(self.integer().filter(|number| *number >= 0)?)),
            None => None,
        };
        self.skip(b']')?;
        Some(Row { index, cell: Cell::new(x, y, z), material })
    }

    #[inline]
    fn event(&mut self) -> Option<NamedEvent<'a>> {
        let (mut is_place, mut at, mut material, mut has_material) = (None, [None; 3], None, false);
        self.skip(b'{')?;
        loop {
            let key = self.text()?;
            self.skip(b':')?;
            match key {
                b"x" if at[0].is_none() => at[0] = Some(self.coordinate(0)?),
                b"y" if at[1].is_none() => at[1] = Some(self.coordinate(1)?),
                b"z" if at[2].is_none() => at[2] = Some(self.coordinate(2)?),
                b"action" if is_place.is_none() => {
                    is_place = match self.text()? {
                        b"place" => Some(true),
                        b"remove" => Some(false),
                        _ => return None,
                    }
                }
                b"material" if !has_material => {
                    has_material = true;
                    material = if self.null().is_some() { None } else { Some(self.text()?) };
                }
                _ => return None,
            }
            if self.skip(b',').is_none() {
                break;
            }
        }
        self.skip(b'}')?;
        let is_place = is_place?;
        if is_place && material.is_none() {
            return None;
        }
        Some(NamedEvent { is_place, cell: Cell::new(at[0]?, at[1]?, at[2]?), material })
    }

    #[inline]
    fn coordinate(&mut self, axis: usize) -> Option<i32> {
        self.integer().filter(|number| range(axis).contains(number))
    }

    #[inline]
    fn integer(&mut self) -> Option<i32> {
        let is_negative = self.skip(b'-').is_some();
        let mut number = 0;
        for (digits, byte) in self.rest.iter().enumerate() {
            let digit = byte.wrapping_sub(b'0');
            if digit > 9 {
                self.rest = &self.rest[digits..];
                return (digits > 0).then_some(if is_negative { -number } else { number });
            }
            if digits == MAX_DIGITS {
                break;
            }
            number = number * 10 + i32::from(digit);
        }
        None
    }

    fn null(&mut self) -> Option<()> {
        self.skip(b'n')?;
        self.rest = self.rest.strip_prefix(b"ull")?;
        Some(())
    }

    /// Reads a string of printable ASCII without escapes.
    #[inline]
    fn text(&mut self) -> Option<&'a [u8]> {
        self.skip(b'"')?;
        let end = self.rest.iter().position(|byte| matches!(byte, b'"' | b'\\' | ..b' ' | 0x7f..))?;
        let (text, rest) = self.rest.split_at(end);
        self.rest = rest.strip_prefix(b"\"")?;
        Some(text)
    }

    /// Skips space and then this byte, if it comes next.
    #[inline]
    fn skip(&mut self, byte: u8) -> Option<()> {
        while let Some((first, rest)) = self.rest.split_first() {
            if *first == byte {
                self.rest = rest;
                return Some(());
            }
            if !matches!(first, b' ' | b'\t' | b'\r' | b'\n') {
                return None;
            }
            self.rest = rest;
        }
        None
    }
}
