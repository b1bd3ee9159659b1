//! The stored form of a log, as `GET /v1/submissions/{id}/log` returns it: one palette, and the rows of each turn.

use serde::de::{IgnoredAny, MapAccess, SeqAccess};
use serde_json::value::RawValue;

use super::code::SentLog;
use super::faults::Faults;
use super::quick::Row;
use super::rows::{PaletteShape, read_rows};
use super::tolerant::{OrNull, ProfileShape, Read, Shape};
use super::{LogLimits, Reader, resolve_rows};
use crate::voxel::block_log::{BlockLog, Turn};

/// The shape of a log in the stored form: `{"palette": ["stone"], "turns": [[[0, -1, 0, 0]]]}`.
#[derive(Debug)]
pub struct StoredLog<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Limits on the log.
    pub limits: LogLimits,
}

impl<'de> Shape<'de> for StoredLog<'_> {
    type Out = SentLog;

    fn wanted(&self) -> &'static str {
        "a stored log: an object with \"palette\" and \"turns\", each turn an array of rows of numbers"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<SentLog>, A::Error> {
        let mut reader = Reader::new(self.faults, self.limits);
        let (mut palette, mut turns, mut profile) = (None, None, None);
        while let Some(key) = members.next_key::<String>()? {
            reader.faults.enter_key(&key);
            match key.as_str() {
                "palette" if palette.is_none() => {
                    palette = Some(members.next_value_seed(Read(PaletteShape { reader: &mut reader }))?);
                }
                "turns" if turns.is_none() => {
                    turns = Some(members.next_value_seed(Read(TurnsOfRows { reader: &mut reader }))?);
                }
                "profile" if profile.is_none() => {
                    let shape = OrNull(ProfileShape { faults: &mut *reader.faults });
                    profile = Some(members.next_value_seed(Read(shape))?);
                }
                "palette" | "turns" | "profile" => {
                    reader.faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    reader.faults.add("unknown field; a stored log has palette, turns and perhaps profile");
                    members.next_value::<IgnoredAny>()?;
                }
            }
            reader.faults.leave();
        }
        for (key, is_missing) in [("palette", palette.is_none()), ("turns", turns.is_none())] {
            if is_missing {
                reader.faults.add_at(key, "missing");
            }
        }
        let (Some(Some(palette)), Some(Some(turns))) = (palette, turns) else { return Ok(None) };
        reader.faults.enter_key("turns");
        let mut resolved: Vec<Turn> = Vec::with_capacity(turns.len());
        for (i, rows) in turns.into_iter().enumerate() {
            reader.faults.enter_index(i);
            resolved.push(resolve_rows(&mut reader, rows, &palette));
            reader.faults.leave();
        }
        reader.faults.leave();
        reader.check_totals();
        let profile = profile.flatten().flatten().flatten().unwrap_or_default();
        Ok(Some(BlockLog { palette: reader.palette, turns: resolved, profile }.into()))
    }
}

struct TurnsOfRows<'r, 'f> {
    reader: &'r mut Reader<'f>,
}

impl<'de> Shape<'de> for TurnsOfRows<'_, '_> {
    type Out = Vec<Vec<Row>>;

    fn wanted(&self) -> &'static str {
        "an array of turns, each an array of rows"
    }

    fn faults(&mut self) -> &mut Faults {
        self.reader.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Vec<Vec<Row>>>, A::Error> {
        let reader = self.reader;
        let mut turns = Vec::new();
        for i in 0.. {
            reader.faults.enter_index(i);
            let json = elements.next_element::<&RawValue>()?;
            let rows = json.map(|json| read_rows(json, reader));
            reader.faults.leave();
            let Some(rows) = rows else { break };
            if i == reader.limits.max_turns {
                reader.faults.add(format!("more than {} turns", reader.limits.max_turns));
            }
            if i < reader.limits.max_turns {
                turns.push(rows.unwrap_or_default());
            }
        }
        Ok(Some(turns))
    }
}
