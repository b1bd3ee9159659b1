//! Bodies of requests: one declaration gives the struct, its reader, which reports all faults, and its schema.

pub mod free;
pub mod values;

use std::marker::PhantomData;

use serde::de::{IgnoredAny, MapAccess};

use self::values::Parsed;
use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{OrNull, ProfileShape, Read, Shape, Text, read_document};

/// Returns the shape of the name of a suite or the id of a run. Names that exist are shorter.
pub const fn name(faults: &mut Faults) -> Text<'_> {
    Text { faults, min_chars: 1, max_chars: LIMITS.suite_chars }
}

/// Returns the shape of the name of a profile.
pub const fn profile(faults: &mut Faults) -> ProfileShape<'_> {
    ProfileShape { faults }
}

/// Fault of a name that changes the direction of the text around it.
pub const DIRECTION_FAULT: &str =
    "characters that change the direction of writing (U+202A to U+202E, U+2066 to U+2069) are not allowed";

/// Returns whether a name would change the direction of the text around it, so that it could look like another.
#[must_use]
pub fn changes_direction(name: &str) -> bool {
    name.contains(|c| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'))
}

/// Characters that nobody sees. Those that join letters and emoji are not among them.
const WITHOUT_WIDTH: [char; 4] = ['\u{200b}', '\u{2060}', '\u{feff}', '\u{00ad}'];

/// Returns the shape of the name of an agent. Spaces around it are left out.
pub fn agent_name(faults: &mut Faults) -> Parsed<'_, String> {
    let parse = |name: &str| match name.trim() {
        "" => Err("expected a name that does not only consist of spaces".to_owned()),
        // In the address of a page, these lead elsewhere.
        "." | ".." => Err("expected a name other than . and ..".to_owned()),
        _ if changes_direction(name) => Err(DIRECTION_FAULT.to_owned()),
        _ if name.contains(WITHOUT_WIDTH) => {
            Err("characters without width (such as U+200B) are not allowed: the name would look like another"
                .to_owned())
        }
        // A name with a space at its end would look like another, too.
        name => Ok(name.to_owned()),
    };
    Parsed { text: Text { faults, min_chars: 1, max_chars: LIMITS.agent_chars }, parse }
}

/// A body that `request_body!` declares. A member of its struct is `None` if it is absent, null or faulty.
pub trait Body: Sized {
    /// Describes the body for fault messages: "an object with …".
    const WANTED: &'static str;

    /// Reads the members of the object.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    fn read<'de, A: MapAccess<'de>>(members: Members<'_, A>) -> Result<Self, A::Error>;
}

/// Reads a body and adds all its faults to `faults`. Returns `None` if it is not an object.
///
/// # Errors
/// Returns an error if the text is not JSON.
pub fn read_body<B: Body>(text: &[u8], faults: &mut Faults) -> Result<Option<B>, serde_json::Error> {
    read_document(text, BodyShape { faults, body: PhantomData })
}

struct BodyShape<'f, B> {
    faults: &'f mut Faults,
    body: PhantomData<B>,
}

impl<'de, B: Body> Shape<'de> for BodyShape<'_, B> {
    type Out = B;

    fn wanted(&self) -> &'static str {
        B::WANTED
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, members: A) -> Result<Option<B>, A::Error> {
        B::read(Members { object: members, faults: self.faults, is_inside: false, has_work: false }).map(Some)
    }
}

/// Declares a body: the struct with its documentation and schema attributes and, for each member, how it is read.
///
/// A member is `required`, `optional`, or one of the members of which exactly one holds the `work` to grade. The
/// argument makes the [`Shape`] of the value from the collector of faults. Where the schema of a member is not that of
/// its type, `#[schema(value_type = …)]` says so, as for a required member, which the struct holds as an option.
/// `unknown` gives the fault of a member with another name.
macro_rules! request_body {
    (
        $(#[$($about:tt)*])*
        pub struct $Body:ident: $wanted:literal {
            $($(#[$($member:tt)*])* $name:ident: $Type:ty = $presence:ident($shape:expr),)*
        }
        unknown: $unknown:expr
    ) => {
        #[derive(Debug, utoipa::ToSchema)]
        #[serde(deny_unknown_fields)]
        $(#[$($about)*])*
        pub struct $Body {
            $($(#[$($member)*])* pub $name: Option<$Type>,)*
        }

        impl $crate::app::body::Body for $Body {
            const WANTED: &'static str = $wanted;

            fn read<'de, A: serde::de::MapAccess<'de>>(
                mut members: $crate::app::body::Members<'_, A>,
            ) -> Result<Self, A::Error> {
                // The slots are members of a struct because a variable would hide the function of the same name.
                struct Slots {
                    $($name: $crate::app::body::Slot<$Type>,)*
                }
                let mut slots = Slots { $($name: $crate::app::body::Slot::$presence(stringify!($name)),)* };
                while let Some(key) = members.next_key()? {
                    match key.as_str() {
                        $(stringify!($name) => members.read(&mut slots.$name, $shape)?,)*
                        unknown => members.refuse_unknown(unknown, $unknown)?,
                    }
                }
                Ok(Self { $($name: members.take(slots.$name, $wanted),)* })
            }
        }
    };
}
pub(crate) use request_body;

/// The members of a body that is being read, and the current location among them.
#[derive(Debug)]
pub struct Members<'f, A> {
    object: A,
    faults: &'f mut Faults,
    /// Whether the current location is a member, and not the body itself.
    is_inside: bool,
    /// Whether one of the members that hold the work was given.
    has_work: bool,
}

impl<'de, A: MapAccess<'de>> Members<'_, A> {
    /// Moves to the next member and returns its name.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    pub fn next_key(&mut self) -> Result<Option<String>, A::Error> {
        if self.is_inside {
            self.faults.leave();
        }
        let key = self.object.next_key::<String>()?;
        self.is_inside = key.is_some();
        if let Some(key) = &key {
            self.faults.enter_key(key);
        }
        Ok(key)
    }

    /// Reads the value of the current member.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    pub fn read<'a, S: Shape<'de>>(
        &'a mut self,
        slot: &mut Slot<S::Out>,
        shape: impl FnOnce(&'a mut Faults) -> S,
    ) -> Result<(), A::Error> {
        match slot.presence {
            // A null counts as absent.
            Presence::Work if self.has_work => {
                if self.object.next_value::<Option<IgnoredAny>>()?.is_some() {
                    self.faults.add("given twice, or beside another member that takes its place; give one of them");
                }
            }
            Presence::Work => {
                let read = self.object.next_value_seed(Read(OrNull(shape(self.faults))))?.flatten();
                self.has_work = read.is_some();
                slot.value = read.flatten();
            }
            _ if slot.is_given => {
                self.faults.add("given twice");
                self.object.next_value::<IgnoredAny>()?;
            }
            Presence::Required => {
                slot.is_given = true;
                slot.value = self.object.next_value_seed(Read(shape(self.faults)))?;
            }
            Presence::Optional => {
                slot.is_given = true;
                slot.value = self.object.next_value_seed(Read(OrNull(shape(self.faults))))?.flatten().flatten();
            }
        }
        Ok(())
    }

    /// Reports the current member, whose name is unknown, and skips its value.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    pub fn refuse_unknown(&mut self, key: &str, detail: impl FnOnce(&str) -> &'static str) -> Result<(), A::Error> {
        self.faults.add(detail(key));
        self.object.next_value::<IgnoredAny>()?;
        Ok(())
    }

    /// Returns the value of a member once all are read. Reports a required member that is missing; if no member holds
    /// the work, reports the first of them that is taken, and what is `wanted`.
    pub fn take<T>(&mut self, slot: Slot<T>, wanted: &str) -> Option<T> {
        let is_missing = match slot.presence {
            Presence::Required => !slot.is_given,
            Presence::Optional => false,
            Presence::Work => !std::mem::replace(&mut self.has_work, true),
        };
        if is_missing {
            let detail = match slot.presence {
                Presence::Work => format!("missing or null; the body must be {wanted}"),
                Presence::Required | Presence::Optional => "missing".to_owned(),
            };
            self.faults.add_at(slot.name, detail);
        }
        slot.value
    }
}

/// Place for the value of a member.
#[derive(Debug)]
pub struct Slot<T> {
    name: &'static str,
    presence: Presence,
    is_given: bool,
    value: Option<T>,
}

#[derive(Debug, Clone, Copy)]
enum Presence {
    Required,
    Optional,
    Work,
}

impl<T> Slot<T> {
    /// Creates the slot of a member that every body has.
    #[must_use]
    pub const fn required(name: &'static str) -> Self {
        Self { name, presence: Presence::Required, is_given: false, value: None }
    }

    /// Creates the slot of a member that may be absent or null.
    #[must_use]
    pub const fn optional(name: &'static str) -> Self {
        Self { name, presence: Presence::Optional, is_given: false, value: None }
    }

    /// Creates the slot of a member that may hold the work to grade; exactly one of them does.
    #[must_use]
    pub const fn work(name: &'static str) -> Self {
        Self { name, presence: Presence::Work, is_given: false, value: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    request_body! {
        /// A body with a member of every kind.
        pub struct Sample: "an object with \"id\"" {
            /// A required member.
            #[schema(value_type = String)]
            id: String = required(name),
            /// An optional member.
            suite: String = optional(name),
            /// One way to give the work.
            turns: String = work(name),
            /// Another way to give the work.
            log: String = work(name),
        }
        unknown: |key| if key == "x" { "unknown field; it belongs in a turn" } else { "unknown field" }
    }

    fn faults_of(text: &str) -> Vec<String> {
        let mut faults = Faults::new();
        read_body::<Sample>(text.as_bytes(), &mut faults).unwrap();
        faults.list().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn every_fault_is_told_with_its_place() {
        assert_eq!(
            faults_of(
                r#"{"id": null, "id": "a", "suite": "s", "suite": null, "x": [1], "y": {}, "turns": "", "log": "l"}"#
            ),
            [
                "/id: expected a string, found null",
                "/id: given twice",
                "/suite: given twice",
                "/x: unknown field; it belongs in a turn",
                "/y: unknown field",
                "/turns: expected 1 to 100 characters, found 0",
                "/log: given twice, or beside another member that takes its place; give one of them",
            ]
        );
        assert_eq!(
            faults_of("{}"),
            ["/id: missing", "/turns: missing or null; the body must be an object with \"id\""]
        );
        assert_eq!(faults_of("[]"), ["expected an object with \"id\", found an array"]);
    }

    #[test]
    fn null_is_no_work() {
        let mut faults = Faults::new();
        let text = br#"{"id": "a", "turns": null, "log": "l", "turns": null}"#;
        let Sample { id, suite, turns, log } = read_body(text, &mut faults).unwrap().unwrap();
        assert_eq!((id.as_deref(), suite, turns, log.as_deref()), (Some("a"), None, None, Some("l")));
        assert!(faults.is_empty());
    }
}
