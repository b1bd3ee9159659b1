//! Fault-tolerant reading of JSON: reads the whole text even if parts of it are wrong, to report all faults at once.
//!
//! serde stops at the first value of the wrong type. A [`Shape`] instead accepts any JSON value; if the value is not of
//! the expected kind, it records a fault, skips the value, and continues. Only text that is not JSON stops the reading.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::faults::Faults;
use crate::text::counted;
use crate::voxel::Profile;

/// A JSON value that is neither an object nor an array.
#[derive(Debug, Clone, PartialEq)]
pub enum Scalar<'a> {
    /// The value `null`.
    Null,
    /// The value `true` or `false`.
    Bool(bool),
    /// An integer that fits into an `i64`.
    Integer(i64),
    /// Any other number.
    Number(f64),
    /// A string.
    Text(&'a str),
}

impl fmt::Display for Scalar<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("null"),
            Self::Bool(b) => write!(f, "{b}"),
            Self::Integer(i) => write!(f, "{i}"),
            Self::Number(x) => write!(f, "{x}"),
            Self::Text(s) if s.chars().count() > 40 => {
                write!(f, "a string of {}", counted(s.chars().count(), "character"))
            }
            Self::Text(s) => write!(f, "{s:?}"),
        }
    }
}

/// The expected shape of one JSON value. Each method reads the value, or records a fault and skips it.
pub trait Shape<'de>: Sized {
    /// Type of the value read. The methods return `None` if the value was faulty.
    type Out;

    /// Describes the expected value for fault messages: "an integer", "an object with …".
    fn wanted(&self) -> &'static str;

    /// Returns the collector of the faults.
    fn faults(&mut self) -> &mut Faults;

    /// Reads a scalar. By default, records a fault.
    fn scalar(mut self, value: &Scalar<'_>) -> Option<Self::Out> {
        let detail = format!("expected {}, found {value}", self.wanted());
        self.faults().add(detail);
        None
    }

    /// Reads an array. By default, records a fault and skips the elements.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    fn array<A: SeqAccess<'de>>(mut self, mut elements: A) -> Result<Option<Self::Out>, A::Error> {
        let detail = format!("expected {}, found an array", self.wanted());
        self.faults().add(detail);
        while elements.next_element::<IgnoredAny>()?.is_some() {}
        Ok(None)
    }

    /// Reads an object. By default, records a fault and skips the members.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    fn object<A: MapAccess<'de>>(mut self, mut members: A) -> Result<Option<Self::Out>, A::Error> {
        let detail = format!("expected {}, found an object", self.wanted());
        self.faults().add(detail);
        while members.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(None)
    }
}

/// Adapter that lets serde read any [`Shape`].
#[derive(Debug)]
pub struct Read<S>(pub S);

impl<'de, S: Shape<'de>> DeserializeSeed<'de> for Read<S> {
    type Value = Option<S::Out>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de, S: Shape<'de>> Visitor<'de> for Read<S> {
    type Value = Option<S::Out>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.wanted())
    }

    fn visit_bool<E>(self, value: bool) -> Result<Self::Value, E> {
        Ok(self.0.scalar(&Scalar::Bool(value)))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Self::Value, E> {
        Ok(self.0.scalar(&Scalar::Integer(value)))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Self::Value, E> {
        let scalar = i64::try_from(value).map_or(Scalar::Number(value as f64), Scalar::Integer);
        Ok(self.0.scalar(&scalar))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Self::Value, E> {
        Ok(self.0.scalar(&Scalar::Number(value)))
    }

    fn visit_str<E>(self, value: &str) -> Result<Self::Value, E> {
        Ok(self.0.scalar(&Scalar::Text(value)))
    }

    fn visit_unit<E>(self) -> Result<Self::Value, E> {
        Ok(self.0.scalar(&Scalar::Null))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, elements: A) -> Result<Self::Value, A::Error> {
        self.0.array(elements)
    }

    fn visit_map<A: MapAccess<'de>>(self, members: A) -> Result<Self::Value, A::Error> {
        self.0.object(members)
    }
}

/// Reads a whole JSON document with `shape`.
///
/// # Errors
/// Returns an error if the text is not JSON, or nests deeper than 128 levels.
pub fn read_document<'de, S: Shape<'de>>(text: &'de [u8], shape: S) -> Result<Option<S::Out>, serde_json::Error> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let value = Read(shape).deserialize(&mut deserializer)?;
    deserializer.end()?;
    Ok(value)
}

/// The shape of what another shape accepts, or `null`, which is equivalent to an absent member.
#[derive(Debug)]
pub struct OrNull<S>(pub S);

impl<'de, S: Shape<'de>> Shape<'de> for OrNull<S> {
    /// `None` for `null`; `Some(None)` if the value was faulty.
    type Out = Option<Option<S::Out>>;

    fn wanted(&self) -> &'static str {
        self.0.wanted()
    }

    fn faults(&mut self) -> &mut Faults {
        self.0.faults()
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<Self::Out> {
        Some(if *value == Scalar::Null { None } else { Some(self.0.scalar(value)) })
    }

    fn array<A: SeqAccess<'de>>(self, elements: A) -> Result<Option<Self::Out>, A::Error> {
        Ok(Some(Some(self.0.array(elements)?)))
    }

    fn object<A: MapAccess<'de>>(self, members: A) -> Result<Option<Self::Out>, A::Error> {
        Ok(Some(Some(self.0.object(members)?)))
    }
}

/// The shape of a string of `min_chars` to `max_chars` characters without control characters.
#[derive(Debug)]
pub struct Text<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Minimum length in characters.
    pub min_chars: usize,
    /// Maximum length in characters.
    pub max_chars: usize,
}

impl Shape<'_> for Text<'_> {
    type Out = String;

    fn wanted(&self) -> &'static str {
        "a string"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<String> {
        let Scalar::Text(text) = value else {
            self.faults.add(format!("expected a string, found {value}"));
            return None;
        };
        let length = text.chars().count();
        if length < self.min_chars || length > self.max_chars {
            let (min, max) = (self.min_chars, self.max_chars);
            self.faults.add(format!("expected {min} to {max} characters, found {length}"));
            None
        } else if text.chars().any(char::is_control) {
            self.faults.add("control characters are not allowed");
            None
        } else {
            Some((*text).to_owned())
        }
    }
}

/// The shape of a string of any characters, such as a script with line breaks and tabs.
#[derive(Debug)]
pub struct Verbatim<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
}

impl Shape<'_> for Verbatim<'_> {
    type Out = String;

    fn wanted(&self) -> &'static str {
        "a string"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<String> {
        if let Scalar::Text(text) = value {
            return Some((*text).to_owned());
        }
        self.faults.add(format!("expected a string, found {value}"));
        None
    }
}

/// The shape of a text, or of a list of texts.
#[derive(Debug)]
pub struct Texts<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Greatest number of texts.
    pub most: usize,
}

impl<'de> Shape<'de> for Texts<'_> {
    type Out = Vec<String>;

    fn wanted(&self) -> &'static str {
        "a string or an array of strings"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<Vec<String>> {
        if let Scalar::Text(text) = value {
            return Some(vec![(*text).to_owned()]);
        }
        self.faults.add(format!("expected a string or an array of strings, found {value}"));
        None
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Vec<String>>, A::Error> {
        let (mut texts, mut is_whole) = (Vec::new(), true);
        for index in 0.. {
            self.faults.enter_index(index);
            let text = elements.next_element_seed(Read(Verbatim { faults: &mut *self.faults }))?;
            self.faults.leave();
            let Some(text) = text else { break };
            if index == self.most {
                self.faults.add(format!("more than {} texts", self.most));
            }
            is_whole &= text.is_some() && index < self.most;
            texts.extend(text.filter(|_| index < self.most));
        }
        if texts.is_empty() && is_whole {
            self.faults.add("expected at least one text");
            is_whole = false;
        }
        Ok(is_whole.then_some(texts))
    }
}

/// The shape of the name of a profile.
#[derive(Debug)]
pub struct ProfileShape<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
}

impl Shape<'_> for ProfileShape<'_> {
    type Out = Profile;

    fn wanted(&self) -> &'static str {
        "\"published\" or \"mindcraft\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<Profile> {
        let named = if let Scalar::Text(name) = value { Profile::named(name) } else { None };
        if named.is_none() {
            self.faults.add(format!(
                "expected \"published\" or \"mindcraft\", found {value}; /v1/profiles tells what they are"
            ));
        }
        named
    }
}

/// The shape of an integer in a range. A number such as `3.0` also counts as an integer (as in JSON Schema).
#[derive(Debug)]
pub struct Integer<'f> {
    /// Collector of the faults.
    pub faults: &'f mut Faults,
    /// Minimum value, inclusive.
    pub min: i64,
    /// Maximum value, inclusive.
    pub max: i64,
}

impl Shape<'_> for Integer<'_> {
    type Out = i64;

    fn wanted(&self) -> &'static str {
        "an integer"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    #[inline]
    fn scalar(self, value: &Scalar<'_>) -> Option<i64> {
        match value {
            Scalar::Integer(i) if (self.min..=self.max).contains(i) => Some(*i),
            other => self.unusual(other),
        }
    }
}

impl Integer<'_> {
    /// Reads an integer that is written as `3.0`, or records a fault.
    #[cold]
    fn unusual(self, value: &Scalar<'_>) -> Option<i64> {
        let (min, max) = (self.min, self.max);
        match value {
            Scalar::Number(x) if x.fract() == 0.0 && *x >= min as f64 && *x <= max as f64 => return Some(*x as i64),
            Scalar::Integer(i) => self.faults.add(format!("{i} is out of range: {min} to {max}")),
            Scalar::Number(x) if x.fract() == 0.0 => self.faults.add(format!("{x} is out of range: {min} to {max}")),
            Scalar::Number(x) => self.faults.add(format!("{x} is not an integer")),
            other => self.faults.add(format!("expected an integer, found {other}")),
        }
        None
    }
}
