//! The facts that receipts state.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::hidden::evidence::{AnswerFact, ClosedFact, CompletedFact, DrawFact, EntryFact, TranscriptFact};

/// The facts that the receipts of an epoch state.
#[derive(Default)]
pub(super) struct Stated<'a> {
    pub entries: BTreeMap<String, EntryFact>,
    pub draws: BTreeMap<(String, u32), DrawFact>,
    pub answers: BTreeMap<String, AnswerFact>,
    pub completed: BTreeMap<String, CompletedFact>,
    pub failed: BTreeSet<String>,
    pub transcripts: BTreeMap<String, TranscriptFact>,
    pub grades: BTreeMap<&'a str, Vec<&'a Value>>,
    pub closed: Vec<(i64, ClosedFact)>,
    /// Number of receipts that fill places.
    pub padding: usize,
    /// Places in the log of grades, by instance.
    pub graded_at: BTreeMap<String, Vec<i64>>,
    /// Places in the log of completions, by entry.
    pub completed_at: BTreeMap<String, i64>,
}
