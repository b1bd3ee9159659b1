//! Free JSON: values that have no shape of their own, read into a bounded amount of memory.
//!
//! A few bytes of text can become hundreds in memory, and a few bytes of a compressed body thousands of such values. So
//! values are counted while they are read, and what is beyond the limit is skipped.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

use crate::app::limits::LIMITS;

/// What an object counts for, beside its members: the number of plain values that take as much memory.
const OBJECT: usize = 8;
/// What a member of an object counts for, beside its value: its name, and its share of the nodes of a tree that are half
/// full.
const MEMBER: usize = 2;
/// What an array counts for, beside its elements.
const ARRAY: usize = 2;
/// Bytes of memory that an element of an array takes, with what a short text allocates.
const VALUE_BYTES: usize = 64;

/// Room for free JSON, for one value.
#[derive(Debug)]
pub struct Room {
    most: usize,
    left: usize,
    is_exceeded: bool,
}

impl Room {
    /// Returns the room of a body that is free JSON as a whole: `free_json_values`.
    #[must_use]
    pub const fn of_body() -> Self {
        Self::of(LIMITS.free_json_values)
    }

    /// Returns the room of a member of a body: `free_json_member_values`.
    #[must_use]
    pub const fn of_member() -> Self {
        Self::of(LIMITS.free_json_member_values)
    }

    const fn of(values: usize) -> Self {
        Self { most: values, left: values, is_exceeded: false }
    }

    /// Returns the fault if there was more than fits; what was read is then incomplete.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        let most = self.most;
        let why = || {
            format!(
                "more than {most} values; an object counts as {OBJECT} more, each of its members as {MEMBER}, an array as {ARRAY}"
            )
        };
        self.is_exceeded.then(why)
    }

    fn take(&mut self, values: usize) {
        self.is_exceeded |= values > self.left;
        self.left = self.left.saturating_sub(values);
    }
}

/// Reads a value of free JSON. Null stands for what has no room.
#[derive(Debug)]
pub struct FreeJson<'r>(pub &'r mut Room);

impl<'de> DeserializeSeed<'de> for FreeJson<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        self.0.take(1);
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for FreeJson<'_> {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Value, A::Error> {
        self.0.take(ARRAY);
        let mut array = Vec::new();
        while !self.0.is_exceeded
            && let Some(element) = elements.next_element_seed(FreeJson(self.0))?
        {
            array.push(element);
        }
        while elements.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        self.0.take(OBJECT);
        let mut object = Map::new();
        while !self.0.is_exceeded
            && let Some(name) = members.next_key::<String>()?
        {
            self.0.take(MEMBER);
            object.insert(name, members.next_value_seed(FreeJson(self.0))?);
        }
        while members.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(Value::Object(object))
    }
}

/// Returns the bytes of memory that a body of free JSON takes at most, besides its text.
#[must_use]
pub fn memory_of(json: &[u8]) -> usize {
    let (mut values, mut is_text, mut is_escaped) = (0_usize, false, false);
    for byte in json {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' if is_text => is_escaped = true,
            b'"' => is_text = !is_text,
            _ if is_text => {}
            b'{' => values += OBJECT + 1,
            // The first element has no comma before it.
            b'[' => values += ARRAY + 2,
            b',' => values += 1,
            b':' => values += MEMBER + 1,
            _ => {}
        }
    }
    VALUE_BYTES * values.min(LIMITS.free_json_values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Value, bool) {
        let mut room = Room::of_body();
        let value = FreeJson(&mut room).deserialize(&mut serde_json::Deserializer::from_str(text)).unwrap();
        (value, room.fault().is_none())
    }

    #[test]
    fn values_come_as_serde_reads_them() {
        let text =
            r#"{"a": [null, true, -1, 18446744073709551615, 1e300, 0.1, "\u2028"], "": {"a": {}, "b": []}, "a b": 1}"#;
        assert_eq!(read(text), (serde_json::from_str(text).unwrap(), true));
    }

    #[test]
    fn values_without_room_are_skipped() {
        let most = LIMITS.free_json_values;
        let list = |element: &str, count: usize| format!("[{}]", vec![element; count].join(","));
        assert!(read(&list("0", most - ARRAY - 1)).1);
        assert!(!read(&list("0", most - ARRAY)).1);
        let (value, fits) = read(&list(r#"{"":[[]]}"#, most));
        assert!(!fits && value.as_array().unwrap().len() <= most / (OBJECT + MEMBER));
    }

    #[test]
    fn the_memory_of_a_body_is_told_from_its_text() {
        assert_eq!(memory_of(br#"{"a": "[{,\\\"[{,", "b": [1, 2]}"#), VALUE_BYTES * (9 + 3 + 1 + 3 + 4 + 1));
        assert_eq!(memory_of(&b"[".repeat(10_000_000)), VALUE_BYTES * LIMITS.free_json_values);
    }
}
