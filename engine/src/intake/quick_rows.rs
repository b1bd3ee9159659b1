//! Rows as programs write them, read byte by byte: a log is mostly rows, and whoever trains a model posts thousands of
//! logs a second.
//!
//! This reader explains nothing. It gives up at whatever is not a row of three or four plain integers within their
//! ranges, and [`RowsShape`](super::rows::RowsShape) reads the same text again, with care.

use super::events::range;
use super::rows::Row;
use crate::voxel::cell::Cell;

/// Most digits of a number that is read here, so that it cannot overflow.
const MAX_DIGITS: usize = 9;

/// Reads an array of rows from JSON that is known to be valid, or returns `None` if anything in it is unusual.
pub(super) fn quick_rows(json: &str) -> Option<Vec<Row>> {
    // The shortest row, with its comma, has eight bytes.
    let mut rows = Vec::with_capacity(json.len() / 8 + 1);
    let mut scanner = Scanner { rest: json.as_bytes() };
    scanner.skip(b'[')?;
    if scanner.skip(b']').is_some() {
        return scanner.end().then_some(rows);
    }
    loop {
        let index = rows.len();
        rows.push(scanner.row(index)?);
        if scanner.skip(b',').is_none() {
            scanner.skip(b']')?;
            return scanner.end().then_some(rows);
        }
    }
}

struct Scanner<'a> {
    rest: &'a [u8],
}

impl Scanner<'_> {
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

    /// Returns whether only space is left.
    fn end(&self) -> bool {
        self.rest.iter().all(u8::is_ascii_whitespace)
    }
}
