//! The member of a body that says what was done: `turns`, or `log` in the stored form.

use serde::de::{IgnoredAny, MapAccess};

use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::Turns;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::stored::StoredLog;
use plumbline_engine::intake::tolerant::{OrNull, Read};

/// What was done, as far as it was read.
#[derive(Debug, Default)]
pub struct LogMember {
    is_given: bool,
    sent: Option<SentLog>,
}

impl LogMember {
    /// Whether the body says it.
    #[must_use]
    pub const fn is_given(&self) -> bool {
        self.is_given
    }

    /// Reads the value of `key`, one of the two.
    ///
    /// # Errors
    /// Only where the text is not JSON.
    pub fn read<'de, A: MapAccess<'de>>(
        &mut self,
        key: &str,
        members: &mut A,
        faults: &mut Faults,
    ) -> Result<(), A::Error> {
        let limits = LIMITS.log();
        // Null is as good as absent.
        let read = match key {
            "log" => members.next_value_seed(Read(OrNull(StoredLog { faults, limits })))?,
            _ => members.next_value_seed(Read(OrNull(Turns { faults, limits })))?,
        };
        self.is_given = read.as_ref().is_some_and(Option::is_some);
        self.sent = read.flatten().flatten();
        Ok(())
    }

    /// Says that it was given before. Null is as good as absent.
    ///
    /// # Errors
    /// Only where the text is not JSON.
    pub fn refuse_second<'de, A: MapAccess<'de>>(&self, members: &mut A, faults: &mut Faults) -> Result<(), A::Error> {
        if members.next_value::<Option<IgnoredAny>>()?.is_some() {
            faults.add("given twice: what was done is given once, as turns, as log or (to grade it) as answer");
        }
        Ok(())
    }

    /// What was read; none where it was not given, or faulty.
    #[must_use]
    pub fn sent(self) -> Option<SentLog> {
        self.sent
    }
}
