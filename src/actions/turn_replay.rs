//! The result of running a turn's code, as it is stored and answered.

use serde::{Deserialize, Serialize};

use super::{ACTION_LIMITS, CodeError, Dropped, MAX_ERRORS, MAX_NOTES, Replayed};

/// Last line of a log that was cut.
pub const LOG_CUT: &str = "… more was printed, which is left out";

/// Result of running the action code of one turn.
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TurnReplay {
    /// Number of the turn, from 1.
    pub turn: usize,
    /// Number of events that the code recorded.
    pub events: usize,
    /// Calls that recorded nothing, counted by reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// Error that ended the code, or a rejection that nothing handled; events recorded before it count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<CodeError>,
    /// Notes for the author although nothing failed, for example that a function was defined but never called.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Further errors: of other files of the turn, and of promises that nothing handled.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub more_errors: Vec<CodeError>,
    /// What the code printed, a line each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub log: Vec<String>,
    /// Whether the code is not valid JavaScript, so that none of it was run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unreadable: bool,
}

impl TurnReplay {
    /// Appends what further code of the same turn told, within the limits of one file.
    pub fn append(&mut self, other: Self) {
        let Self { turn: _, events, dropped, error, notes, more_errors, log, unreadable } = other;
        let before = self.events;
        self.events += events;
        for Dropped { reason, count } in dropped {
            let is_full = self.dropped.len() > MAX_NOTES;
            match self.dropped.iter_mut().find(|known| known.reason == reason) {
                Some(known) => known.count += count,
                None if is_full => {}
                None => self.dropped.push(Dropped { reason, count }),
            }
        }
        let later = |error: CodeError| CodeError { events: error.events.map(|events| before + events), ..error };
        let mut errors = error.into_iter().chain(more_errors).map(later);
        if self.error.is_none() {
            self.error = errors.next();
        }
        let room = (MAX_ERRORS - 1).saturating_sub(self.more_errors.len());
        self.more_errors.extend(errors.take(room));
        for note in notes {
            if self.notes.len() <= MAX_NOTES && !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
        self.unreadable &= unreadable;
        if self.log.last().is_some_and(|last| last == LOG_CUT) {
            return;
        }
        let mut room = ACTION_LIMITS.log_bytes.saturating_sub(self.log.iter().map(|line| line.len() + 1).sum());
        for line in log {
            let is_full = self.log.len() >= ACTION_LIMITS.log_lines || line.len() > room;
            if is_full {
                self.log.push(LOG_CUT.to_owned());
                break;
            }
            room = room.saturating_sub(line.len() + 1);
            self.log.push(line);
        }
    }

    /// Tells how the code of a turn, counted from 1, was run.
    #[must_use]
    pub fn of(turn: usize, done: Replayed) -> Self {
        let Replayed { events, dropped, error, notes, unreadable, more_errors, log, .. } = done;
        Self { turn, events: events.len(), dropped, error, notes, more_errors, log, unreadable }
    }
}
