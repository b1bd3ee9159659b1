//! Member of a body that holds the log: `turns`, or `log` in the stored form.

use serde::de::{IgnoredAny, MapAccess};

use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::Turns;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::stored::StoredLog;
use plumbline_engine::intake::tolerant::{OrNull, Read};

/// Log of a body, as far as it was read.
#[derive(Debug, Default)]
pub struct LogMember {
    is_given: bool,
    sent: Option<SentLog>,
}

impl LogMember {
    /// Returns whether the body has the member.
    #[must_use]
    pub const fn is_given(&self) -> bool {
        self.is_given
    }

    /// Reads the value of `key`, which is `turns` or `log`.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    pub fn read<'de, A: MapAccess<'de>>(
        &mut self,
        key: &str,
        members: &mut A,
        faults: &mut Faults,
    ) -> Result<(), A::Error> {
        let limits = LIMITS.log();
        // Treat null like an absent member.
        let read = match key {
            "log" => members.next_value_seed(Read(OrNull(StoredLog { faults, limits })))?,
            _ => members.next_value_seed(Read(OrNull(Turns { faults, limits })))?,
        };
        self.is_given = read.as_ref().is_some_and(Option::is_some);
        self.sent = read.flatten().flatten();
        Ok(())
    }

    /// Reports that the log was given twice. Null counts as absent.
    ///
    /// # Errors
    /// Returns an error only if the text is not JSON.
    pub fn refuse_second<'de, A: MapAccess<'de>>(&self, members: &mut A, faults: &mut Faults) -> Result<(), A::Error> {
        if members.next_value::<Option<IgnoredAny>>()?.is_some() {
            faults.add("given twice: expected exactly one of turns, log and (to grade it) answer");
        }
        Ok(())
    }

    /// Returns the log; none if it was not given or has faults.
    #[must_use]
    pub fn sent(self) -> Option<SentLog> {
        self.sent
    }
}
