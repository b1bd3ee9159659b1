//! Announcements: entries of the public log that are no grades and belong to no entrant. They are public at once, so an
//! epoch that was announced cannot vanish, and an action on a board cannot be undone in silence.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::beacon::BoundPool;
use super::commitment::Commitment;
use crate::tasks::hex;

/// What an entry of the log announces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Announcement {
    /// An epoch, with everything that it commits to.
    Epoch(EpochFact),
    /// The pool of an epoch that is bound to a beacon.
    Pool(BoundPool),
    /// An action on a row of a board.
    BoardAction(BoardActionFact),
}

/// The announcement of an epoch.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EpochFact {
    /// The commitment.
    pub commitment: Box<Commitment>,
    /// Time of the announcement, milliseconds since 1970.
    pub committed_at_ms: i64,
}

/// An action on a row of a board. What it says is in the board's record of actions; here is its hash, so that the log
/// keeps no text that somebody wrote.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardActionFact {
    /// Identifier of the run.
    pub run: String,
    /// Kind of the action.
    pub action: String,
    /// SHA-256 of the reason that was given, of its characters in UTF-8.
    pub reason_sha256: String,
    /// Time of the action, milliseconds since 1970.
    pub at_ms: i64,
}

impl BoardActionFact {
    /// Creates the entry for an action.
    #[must_use]
    pub fn of(run: &str, action: &str, reason: &str, at_ms: i64) -> Self {
        Self { run: run.to_owned(), action: action.to_owned(), reason_sha256: hex(&Sha256::digest(reason)), at_ms }
    }
}

/// Builds the entry of the log.
#[must_use]
pub fn receipt(announcement: &Announcement) -> Value {
    let mut receipt = json!(announcement);
    receipt["plumbline_receipt"] = 1.into();
    receipt
}

/// Reads what an entry of the log announces; `None` if it is a grade or of another kind.
#[must_use]
pub fn announcement(receipt: &Value) -> Option<Announcement> {
    const NAMES: [&str; 3] = ["epoch", "pool", "board_action"];
    // Receipts of an epoch have its name under the same member.
    let name = NAMES.into_iter().find(|name| receipt.get(name).is_some_and(Value::is_object))?;
    serde_json::from_value(json!({ name: receipt[name] })).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_announcement_reads_back_from_its_entry() {
        let action = Announcement::BoardAction(BoardActionFact::of("run", "hide", "a copy", 5));
        let entry = receipt(&action);
        assert_eq!(entry["board_action"]["run"], "run");
        assert!(!entry.to_string().contains("a copy"), "{entry}");
        assert_eq!(announcement(&entry), Some(action));
        assert_eq!(announcement(&json!({ "epoch": "autumn", "entry": {} })), None);
        assert_eq!(announcement(&json!({ "submission": "s", "overall": true })), None);
    }
}
