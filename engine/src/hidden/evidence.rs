//! Evidence of what happened in an epoch: a receipt for each step, signed when it happens and not only when it is revealed.
//!
//! Whoever takes a step is given its receipt at once. All of an epoch's receipts come into the public log in batches, as hashes that
//! a salt keeps from being guessed, and are released with the reveal: so what is revealed can be held against what was signed.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::feedback::Tier;
use super::receipts::Signed;
use crate::tasks::hex;

/// What a receipt of hidden evaluation says, beside grades, which have receipts of their own form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fact {
    /// An entry was registered.
    Entry(EntryFact),
    /// A run was drawn.
    Draw(DrawFact),
    /// An answer was taken.
    Answer(AnswerFact),
    /// The transcript that was promised with an answer was shown.
    Transcript(TranscriptFact),
    /// The service failed to grade an answer.
    Failure(FailureFact),
    /// An entry was finalized, and all its answers are graded or have failed.
    Completed(CompletedFact),
    /// The epoch is over, and this is the last of its receipts.
    Closed(ClosedFact),
}

/// An entry as it was registered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EntryFact {
    /// Its id.
    pub id: String,
    /// Who registered it; empty where the service was open to everybody.
    pub owner: String,
    /// Who is evaluated.
    pub agent: String,
    /// SHA-256 of the configuration.
    pub configuration_sha256: String,
    /// Its tier.
    pub tier: Tier,
    /// Runs registered.
    pub runs: u32,
    /// When.
    pub registered_at_ms: i64,
}

/// A run as it was drawn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DrawFact {
    /// The entry.
    pub entry: String,
    /// The run, from 1.
    pub run: u32,
    /// The entrant's nonce.
    pub nonce: String,
    /// The instances issued, in order.
    pub instances: Vec<String>,
    /// When.
    pub drawn_at_ms: i64,
}

/// An answer as it was taken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerFact {
    /// The instance.
    pub instance: String,
    /// The entry that it belongs to.
    pub entry: String,
    /// SHA-256 of the log's canonical JSON.
    pub log_sha256: String,
    /// What was promised of the agent's transcript.
    pub transcript_sha256: Option<String>,
    /// When.
    pub answered_at_ms: i64,
}

/// A transcript as it was shown.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TranscriptFact {
    /// The instance.
    pub instance: String,
    /// Its SHA-256, as it was promised.
    pub transcript_sha256: String,
    /// When.
    pub checked_at_ms: i64,
}

/// A failure of the service.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailureFact {
    /// The instance.
    pub instance: String,
    /// The submission that answered it.
    pub submission: String,
    /// Why it was not graded.
    pub why: String,
    /// When.
    pub failed_at_ms: i64,
}

/// The end of an entry.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CompletedFact {
    /// The entry.
    pub entry: String,
    /// When it was finalized.
    pub finalized_at_ms: i64,
    /// When all its answers were graded.
    pub completed_at_ms: i64,
}

/// The end of an epoch.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClosedFact {
    /// When it was over.
    pub closed_at_ms: i64,
    /// Why.
    pub reason: String,
    /// How many receipts of the epoch come before this one.
    pub receipts: u64,
}

/// The receipt of a fact. The salt is random: without it nobody can guess what a hash in the log stands for.
#[must_use]
pub fn receipt(epoch: &str, salt: &[u8; 32], fact: &Fact) -> Value {
    let mut receipt = json!(fact);
    receipt["plumbline_receipt"] = 1.into();
    receipt["epoch"] = epoch.into();
    receipt["salt"] = hex(salt).into();
    receipt
}

/// The fact that a receipt of an epoch states; none where it is a grade or of another kind.
#[must_use]
pub fn fact(receipt: &Value) -> Option<Fact> {
    const NAMES: [&str; 7] = ["entry", "draw", "answer", "transcript", "failure", "completed", "closed"];
    let name = NAMES.into_iter().find(|name| receipt.get(name).is_some())?;
    serde_json::from_value(json!({ name: receipt[name] })).ok()
}

/// A receipt as it is given to whoever took the step: to be kept, and held against the log and the reveal later.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct GivenReceipt {
    /// The receipt.
    #[schema(value_type = Object)]
    pub receipt: Value,
    /// SHA-256 of the receipt's canonical JSON.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub hash: String,
    /// Ed25519 signature over that JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub signature: String,
    /// The public key that verifies it.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub public_key: String,
}

impl GivenReceipt {
    /// Of a signed receipt.
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
    }
}
