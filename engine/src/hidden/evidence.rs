//! Evidence of the events of an epoch: a receipt for each step, signed when the step happens and not only at the
//! reveal.
//!
//! The client that registers an entry or sends an answer receives the receipt immediately. All receipts of an epoch
//! enter the public log in batches, as hashes that a salt protects from guessing. Their bodies are released with the
//! reveal, so the reveal can be compared with what was signed.

use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::canonical::hash_of;
use super::feedback::Tier;
use super::receipts::Signed;
use crate::tasks::hex;

/// The statement of a receipt of hidden evaluation. Grades are not included: their receipts have a separate form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fact {
    /// An entry was registered.
    Entry(EntryFact),
    /// A run was drawn.
    Draw(DrawFact),
    /// An answer was accepted.
    Answer(AnswerFact),
    /// The transcript promised with an answer was shown.
    Transcript(TranscriptFact),
    /// The service failed to grade an answer.
    Failure(FailureFact),
    /// An entry was finalized, and each of its answers was graded or could not be graded.
    Completed(CompletedFact),
    /// Nothing: it fills a place in the log that the grade of an answer may take, so that its growth tells nothing.
    Padding(PaddingFact),
    /// The epoch is over; this is its last receipt.
    Closed(ClosedFact),
}

/// The registration of an entry.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EntryFact {
    /// Identifier of the entry.
    pub id: String,
    /// Owner that registered the entry; empty if the service was open to everyone.
    pub owner: String,
    /// Name of the evaluated agent.
    pub agent: String,
    /// SHA-256 of the agent's configuration.
    pub configuration_sha256: String,
    /// Tier of the entry.
    pub tier: Tier,
    /// Number of registered runs.
    pub runs: u32,
    /// Time of registration, milliseconds since 1970.
    pub registered_at_ms: i64,
}

/// The draw of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DrawFact {
    /// Identifier of the entry.
    pub entry: String,
    /// Number of the run, from 1.
    pub run: u32,
    /// The entrant's nonce.
    pub nonce: String,
    /// Proof of the draw, in hex; absent in epochs without a key of draws.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<String>,
    /// Identifiers of the issued instances, in the order of issue.
    pub instances: Vec<String>,
    /// What the entrant was asked, in the order of the instances: [`prompts_hash`] of the prompts of each. Empty in
    /// receipts of older programs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub prompts_sha256: Vec<String>,
    /// Time of the draw, milliseconds since 1970.
    pub drawn_at_ms: i64,
}

/// The acceptance of an answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerFact {
    /// Identifier of the instance.
    pub instance: String,
    /// Identifier of the entry to which the instance belongs.
    pub entry: String,
    /// SHA-256 of the canonical JSON of the block log.
    pub log_sha256: String,
    /// Promised SHA-256 of the agent's transcript, if any.
    pub transcript_sha256: Option<String>,
    /// Time of acceptance, milliseconds since 1970.
    pub answered_at_ms: i64,
}

/// The presentation of a promised transcript.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TranscriptFact {
    /// Identifier of the instance.
    pub instance: String,
    /// SHA-256 of the transcript, as promised.
    pub transcript_sha256: String,
    /// Time when the transcript was checked, milliseconds since 1970.
    pub checked_at_ms: i64,
}

/// A failure of the service to grade an answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailureFact {
    /// Identifier of the instance.
    pub instance: String,
    /// Identifier of the submission with the answer.
    pub submission: String,
    /// Reason why the answer was not graded.
    pub why: String,
    /// Time of the failure, milliseconds since 1970.
    pub failed_at_ms: i64,
}

/// The completion of an entry.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CompletedFact {
    /// Identifier of the entry.
    pub entry: String,
    /// Time of finalization, milliseconds since 1970.
    pub finalized_at_ms: i64,
    /// Time of completion, when all answers were graded, milliseconds since 1970.
    pub completed_at_ms: i64,
}

/// A place in the log that states nothing. Its receipt has a salt, so its hash is like any other.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaddingFact {}

/// The end of an epoch.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClosedFact {
    /// Time when the epoch ended, milliseconds since 1970.
    pub closed_at_ms: i64,
    /// Reason for the end.
    pub reason: String,
    /// Number of receipts of the epoch before this one.
    pub receipts: u64,
}

/// Computes what the receipt of a draw states of an instance's prompts: SHA-256, in hex, over the canonical JSON of their
/// list. The prompts are known to the entrant, so the hash tells nothing more.
#[must_use]
pub fn prompts_hash<'a>(prompts: impl Iterator<Item = &'a str>) -> String {
    hex(&hash_of(&prompts.collect::<Vec<&str>>()))
}

impl fmt::Display for Fact {
    /// Says in words what the receipt confirms.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Entry(fact) => write!(f, "the registration of entry {}", fact.id),
            Self::Draw(fact) => write!(f, "the draw of run {} of entry {}", fact.run, fact.entry),
            Self::Answer(fact) => write!(f, "the answer to instance {}", fact.instance),
            Self::Transcript(fact) => write!(f, "the transcript of instance {}", fact.instance),
            Self::Failure(fact) => write!(f, "a failure to grade instance {}", fact.instance),
            Self::Completed(fact) => write!(f, "the completion of entry {}", fact.entry),
            Self::Padding(_) => f.write_str("nothing"),
            Self::Closed(_) => f.write_str("the end of the epoch"),
        }
    }
}

/// Builds the receipt of a fact. The salt is random; it prevents anyone from guessing the receipt behind a hash in the
/// log.
#[must_use]
pub fn receipt(epoch: &str, salt: &[u8; 32], fact: &Fact) -> Value {
    let mut receipt = json!(fact);
    receipt["plumbline_receipt"] = 1.into();
    receipt["epoch"] = epoch.into();
    receipt["salt"] = hex(salt).into();
    receipt
}

/// Reads the fact that a receipt of an epoch states; returns `None` for a grade or any other kind of receipt.
#[must_use]
pub fn fact(receipt: &Value) -> Option<Fact> {
    const NAMES: [&str; 8] = ["entry", "draw", "answer", "transcript", "failure", "completed", "padding", "closed"];
    let mut named = NAMES.into_iter().filter(|name| receipt.get(name).is_some());
    // A receipt states one fact, and one that fills a place nothing else.
    let name = named.next().filter(|_| named.next().is_none())?;
    if name == "padding" && receipt.as_object()?.len() != 4 {
        return None;
    }
    serde_json::from_value(json!({ name: receipt[name] })).ok()
}

/// A receipt as the client receives it, to be kept and later compared with the public log and the reveal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct GivenReceipt {
    /// The receipt.
    #[schema(value_type = Object)]
    pub receipt: Value,
    /// SHA-256 of the receipt's canonical JSON.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub hash: String,
    /// Ed25519 signature over the canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub signature: String,
    /// Public key that verifies the signature, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub public_key: String,
}

impl GivenReceipt {
    /// Combines a receipt with its signature.
    #[must_use]
    pub fn of(receipt: Value, signed: &Signed) -> Self {
        Self {
            receipt,
            hash: hex(&signed.hash),
            signature: signed.signature.clone(),
            public_key: signed.public_key.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fact_reads_back_from_its_receipt() {
        let closed = Fact::Closed(ClosedFact { closed_at_ms: 5, reason: "its time is over".to_owned(), receipts: 7 });
        let receipt = receipt("2026-11", &[1; 32], &closed);
        assert_eq!(receipt["epoch"], "2026-11");
        assert_eq!(fact(&receipt), Some(closed));
        assert_eq!(fact(&json!({ "plumbline_receipt": 1, "overall": true, "submission": "s" })), None);
        let padding = Fact::Padding(PaddingFact {});
        let mut receipt = super::receipt("2026-11", &[1; 32], &padding);
        assert_eq!(fact(&receipt), Some(padding));
        // Nothing hides behind a padding.
        receipt["overall"] = true.into();
        assert_eq!(fact(&receipt), None);
    }
}
