//! The logs of a batch, as they stand in its body.

use std::fmt;
use std::io::BufRead as _;
use std::ops::Range;

use bytes::Bytes;
use serde::de::{IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;

use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::submissions::posted::Format;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::not_json::why_not_json;

/// What a body should be.
const NO_ARRAY: &str = "expected an array of requests, or one request per line as application/x-ndjson";

/// A request in the body: its bytes, and its line if the body is NDJSON.
pub(super) struct Item {
    pub range: Range<usize>,
    pub line: Option<u64>,
}

/// Returns the items of the body.
///
/// # Errors
/// Returns an error if it is neither NDJSON nor an array, or has no log or too many.
pub(super) fn split(bytes: &Bytes, format: Format) -> AppResult<Vec<Item>> {
    let mut items = Vec::new();
    let range_of = |part: &[u8]| {
        let start = part.as_ptr() as usize - bytes.as_ptr() as usize;
        start..start + part.len()
    };
    match format {
        Format::NdJson => {
            let mut rest = &bytes[..];
            for line in 1.. {
                let text = rest;
                let length = rest.skip_until(b'\n').map_err(|error| AppError::internal(&error))?;
                if length == 0 {
                    break;
                }
                let text = text[..length].strip_suffix(b"\n").unwrap_or(&text[..length]);
                if !text.iter().all(u8::is_ascii_whitespace) {
                    items.push(Item { range: range_of(text), line: Some(line) });
                    if items.len() > LIMITS.grade_batch_logs {
                        break;
                    }
                }
            }
        }
        Format::Json => {
            let Parts(parts) = serde_json::from_slice(bytes).map_err(|error| {
                let mut faults = Faults::new();
                let is_json = serde_json::from_slice::<IgnoredAny>(bytes).is_ok();
                if is_json {
                    faults.add(format!("{NO_ARRAY}, found another value"));
                    return AppError::faulty(faults);
                }
                faults.add(format!("{}; {NO_ARRAY}", why_not_json(bytes, &error)));
                AppError::malformed(faults)
            })?;
            let range = |part: &RawValue| range_of(part.get().as_bytes());
            items.extend(parts.into_iter().map(|part| Item { range: range(part), line: None }));
        }
    }
    if items.is_empty() || items.len() > LIMITS.grade_batch_logs {
        let mut faults = Faults::new();
        let found = if items.is_empty() { "no logs" } else { "too many logs" };
        faults.add(format!("{found}; expected 1 to {}", LIMITS.grade_batch_logs));
        return Err(AppError::faulty(faults));
    }
    Ok(items)
}

/// The first elements of an array: as many as a batch may have, and one more if there is one.
struct Parts<'a>(Vec<&'a RawValue>);

impl<'de> Deserialize<'de> for Parts<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(Self(Vec::new()))
    }
}

impl<'de> Visitor<'de> for Parts<'de> {
    type Value = Self;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an array")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut elements: A) -> Result<Self, A::Error> {
        while self.0.len() <= LIMITS.grade_batch_logs
            && let Some(part) = elements.next_element()?
        {
            self.0.push(part);
        }
        while elements.next_element::<IgnoredAny>()?.is_some() {}
        Ok(self)
    }
}
