//! The compact form of a turn: a palette, and rows of numbers.

use serde::de::{IgnoredAny, SeqAccess};
use serde_json::value::RawValue;

use super::Reader;
use super::events::{MaterialShape, cell_of, coordinate};
use super::faults::Faults;
use super::quick::{Row, quick_rows};
use super::tolerant::{Read, Scalar, Shape, read_document};
use crate::text::counted;
use crate::voxel::palette::MaterialId;

pub(super) struct PaletteShape<'r, 'f> {
    pub(super) reader: &'r mut Reader<'f>,
}

impl<'de> Shape<'de> for PaletteShape<'_, '_> {
    type Out = Vec<MaterialId>;

    fn wanted(&self) -> &'static str {
        "an array of material names"
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Vec<MaterialId>>, A::Error> {
        let reader = self.reader;
        let mut names = Vec::new();
        array_of!(elements, reader, MaterialShape { reader: &mut *reader }, |i, name| {
            if names.len() <= reader.limits.max_materials {
                names.push(name.unwrap_or(0));
            }
        });
        if names.len() > reader.limits.max_materials {
            reader.faults.add(format!("more than {} materials", reader.limits.max_materials));
        }
        Ok(Some(names))
    }
}

/// Reads an array of rows from its JSON, at the current location. Returns `None` if it is faulty.
pub(super) fn read_rows(json: &RawValue, reader: &mut Reader<'_>) -> Option<Vec<Row>> {
    let Some(rows) = quick_rows(json.get(), reader.events_left()) else { return read_with_care(json.get(), reader) };
    reader.events += rows.len();
    Some(rows)
}

fn read_with_care(json: &str, reader: &mut Reader<'_>) -> Option<Vec<Row>> {
    let depth = reader.faults.depth();
    let rows = read_document(json.as_bytes(), RowsShape { reader: &mut *reader });
    rows.unwrap_or_else(|error| reader.cut_short(depth, &error))
}

struct RowsShape<'r, 'f> {
    reader: &'r mut Reader<'f>,
}

impl<'de> Shape<'de> for RowsShape<'_, '_> {
    type Out = Vec<Row>;

    fn wanted(&self) -> &'static str {
        "an array of rows [x, y, z, i] or [x, y, z]"
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Vec<Row>>, A::Error> {
        let reader = self.reader;
        let mut rows = Vec::new();
        array_of!(elements, reader, RowShape { index: i, faults: &mut *reader.faults }, |i, row| {
            if reader.count_event() {
                rows.extend(row);
            }
        });
        Ok(Some(rows))
    }
}

struct RowShape<'f> {
    index: usize,
    faults: &'f mut Faults,
}

impl<'de> Shape<'de> for RowShape<'_> {
    type Out = Row;

    fn wanted(&self) -> &'static str {
        "a row: [x, y, z, i] places palette entry i, [x, y, z] removes"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Row>, A::Error> {
        let faults = self.faults;
        let mut at = [None; 3];
        let mut material = None;
        let mut length = 0usize;
        loop {
            faults.enter_index(length);
            let value = match length {
                0..=2 => elements.next_element_seed(Read(coordinate(length, faults)))?,
                3 => elements.next_element_seed(Read(EntryShape { faults }))?,
                _ => elements.next_element::<IgnoredAny>()?.map(|_| None),
            };
            faults.leave();
            let Some(value) = value else { break };
            match length {
                0..=2 => at[length] = value,
                3 => material = Some(value),
                _ => {}
            }
            length += 1;
        }
        if !(3..=4).contains(&length) {
            faults.add(format!("expected 3 or 4 numbers, found {}", counted(length, "value")));
            return Ok(None);
        }
        let Some(cell) = cell_of(at) else { return Ok(None) };
        Ok(match material {
            None => Some(Row { index: self.index, cell, material: None }),
            Some(Some(i)) => Some(Row { index: self.index, cell, material: Some(i) }),
            Some(None) => None,
        })
    }
}

/// The shape of the number of a palette entry.
struct EntryShape<'f> {
    faults: &'f mut Faults,
}

impl Shape<'_> for EntryShape<'_> {
    type Out = i64;

    fn wanted(&self) -> &'static str {
        "the number of a palette entry, from 0"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<i64> {
        let number = match value {
            Scalar::Integer(i) => Some(*i),
            Scalar::Number(x) if x.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(x) => Some(*x as i64),
            _ => None,
        };
        let number = number.filter(|number| u32::try_from(*number).is_ok());
        if number.is_none() {
            self.faults.add(format!("expected {}, found {value}", self.wanted()));
        }
        number
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::intake::LogLimits;

    const LIMITS: LogLimits = LogLimits { max_turns: 2, max_events: 4, max_materials: 2, max_material_chars: 10 };

    /// Returns the rows and the faults that a reader finds.
    fn found(read: impl FnOnce(&mut Reader<'_>) -> Option<Vec<Row>>) -> (Option<Vec<Row>>, Vec<String>) {
        let mut faults = Faults::new();
        let rows = read(&mut Reader::new(&mut faults, LIMITS));
        (rows, faults.list().iter().map(ToString::to_string).collect())
    }

    fn json(text: &str) -> Option<&RawValue> {
        serde_json::from_str(text).ok()
    }

    #[test]
    fn plain_rows_are_read_quickly() {
        for (text, count) in [
            ("[]", 0),
            (" [ ] ", 0),
            ("[[1,2,3]]", 1),
            ("[[-1,-2048,30000000,7],[0,2047,-30000000]]", 2),
            ("[\n\t[ 1 , 2 , 3 , 0 ] ,\r\n\t[ 1 , 2 , -0 ]\n]", 2),
        ] {
            assert_eq!(quick_rows(text, 4).map(|rows| rows.len()), Some(count), "{text}");
        }
    }

    #[test]
    fn a_number_that_cannot_be_read_is_a_fault_in_its_place() {
        let mut faults = Faults::new();
        let mut reader = Reader::new(&mut faults, LIMITS);
        assert!(read_rows(json("[[1,2,3],[1,1e999,3]]").unwrap(), &mut reader).is_none());
        assert_eq!(faults.list()[0].to_string(), "/1/1: number out of range");
        assert_eq!(faults.depth(), 0);
    }

    #[test]
    fn the_number_of_an_entry_is_asked_for_in_the_words_of_a_palette() {
        for (entry, told) in [("-1", "-1"), ("1e300", &format!("{}", 1e300)), ("null", "null"), ("0.5", "0.5")] {
            let text = format!("[[1,2,3,{entry}]]");
            let (_, faults) = found(|reader| read_rows(json(&text).unwrap(), reader));
            assert_eq!(faults, [format!("/0/3: expected the number of a palette entry, from 0, found {told}")]);
        }
        assert_eq!(found(|reader| read_rows(json("[[1,2,3,1.0]]").unwrap(), reader)).1, [""; 0]);
    }

    proptest! {
        #[test]
        fn rows_are_the_same_however_they_are_read(
            rows in prop::collection::vec("( ?\\[ ?(-?(0|[1-9][0-9]{0,10})(\\.0|e1)?[ \n]?, ?){2,3}(-?[0-3]|null|\"1\")\\] ?)", 0..6),
        ) {
            let text = format!("[{}]", rows.join(","));
            let Some(json) = json(&text) else { return Ok(()) };
            let (rows, faults) = found(|reader| read_rows(json, reader));
            let (with_care, careful_faults) = found(|reader| read_with_care(json.get(), reader));
            prop_assert_eq!(rows, with_care);
            prop_assert_eq!(faults, careful_faults);
        }
    }
}
