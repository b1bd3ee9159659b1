//! The compact form of a turn: a palette, and rows of numbers.

use serde::de::{IgnoredAny, SeqAccess};

use super::Reader;
use super::events::{MaterialShape, cell_of, coordinate};
use super::faults::Faults;
use super::tolerant::{Integer, Read, Shape};
use crate::text::counted;
use crate::voxel::cell::Cell;
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

pub(super) struct RowsShape<'r, 'f> {
    pub(super) reader: &'r mut Reader<'f>,
}

pub(super) struct Row {
    pub(super) index: usize,
    pub(super) cell: Cell,
    pub(super) material: Option<i64>,
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
                3 => elements.next_element_seed(Read(Integer { faults, min: 0, max: i64::from(u32::MAX) }))?,
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
