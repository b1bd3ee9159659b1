//! Shapes of values of which serde or the engine reads the form, and a function the meaning.

use serde::de::{MapAccess, SeqAccess, Visitor as _};
use serde_json::Value;

use super::free::{FreeJson, Room};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{Scalar, Shape, Text};

/// The shape of a string from which a function makes a value, or says why it cannot.
#[derive(Debug)]
pub struct Parsed<'f, T> {
    /// Shape of the string.
    pub text: Text<'f>,
    /// Makes the value.
    pub parse: fn(&str) -> Result<T, String>,
}

impl<T> Shape<'_> for Parsed<'_, T> {
    type Out = T;

    fn wanted(&self) -> &'static str {
        self.text.wanted()
    }

    fn faults(&mut self) -> &mut Faults {
        self.text.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<T> {
        let Text { faults, min_chars, max_chars } = self.text;
        let text = Text { faults: &mut *faults, min_chars, max_chars }.scalar(value)?;
        (self.parse)(&text).map_err(|why| faults.add(why)).ok()
    }
}

/// The shape of any JSON value, from which a function makes a value, or adds faults.
#[derive(Debug)]
pub struct Json<'f, T> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Makes the value.
    pub read: fn(&Value, &mut Faults) -> Option<T>,
}

impl<T> Json<'_, T> {
    fn whole(self, value: &Value, room: &Room) -> Option<T> {
        if let Some(why) = room.fault() {
            self.faults.add(why);
            return None;
        }
        (self.read)(value, self.faults)
    }
}

impl<'de, T> Shape<'de> for Json<'_, T> {
    type Out = T;

    fn wanted(&self) -> &'static str {
        "a JSON value"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<T> {
        let value = match *value {
            Scalar::Null => Value::Null,
            Scalar::Bool(value) => value.into(),
            Scalar::Integer(value) => value.into(),
            Scalar::Number(value) => value.into(),
            Scalar::Text(value) => value.into(),
        };
        (self.read)(&value, self.faults)
    }

    fn array<A: SeqAccess<'de>>(self, elements: A) -> Result<Option<T>, A::Error> {
        let mut room = Room::of_member();
        let value = FreeJson(&mut room).visit_seq(elements)?;
        Ok(self.whole(&value, &room))
    }

    fn object<A: MapAccess<'de>>(self, members: A) -> Result<Option<T>, A::Error> {
        let mut room = Room::of_member();
        let value = FreeJson(&mut room).visit_map(members)?;
        Ok(self.whole(&value, &room))
    }
}
