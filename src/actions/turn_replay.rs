//! The result of running a turn's code, as it is stored and answered.

use serde::{Deserialize, Serialize};

use super::{CodeError, Dropped, Replayed};

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
    /// Tells how the code of a turn, counted from 1, was run.
    #[must_use]
    pub fn of(turn: usize, done: Replayed) -> Self {
        let Replayed { events, dropped, error, notes, unreadable, more_errors, log, .. } = done;
        Self { turn, events: events.len(), dropped, error, notes, more_errors, log, unreadable }
    }
}
