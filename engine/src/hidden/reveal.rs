//! The reveal of an epoch: everything that it held back, as the service publishes it when the epoch is over.

use serde::{Deserialize, Serialize};

use super::commitment::{Commitment, leaf_hash, salt};
use super::feedback::Tier;
use super::pool::Specification;
use super::receipts::ReceiptFile;
use super::secret::EpochKey;
use crate::checks::Criterion;
use crate::tasks::hex;

/// A specification with what its leaf was made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedSpecification {
    /// The salt of its leaf.
    pub salt: String,
    /// The leaf's hash.
    pub hash: String,
    /// The specification.
    #[serde(flatten)]
    pub specification: Specification,
}

/// An entry of the epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedEntry {
    /// Its id.
    pub id: String,
    /// Who was evaluated.
    pub agent: String,
    /// SHA-256 of the configuration, as registered.
    pub configuration_hash: String,
    /// Its tier.
    pub tier: Tier,
    /// Runs registered.
    pub runs: u32,
    /// When it was registered.
    pub registered_at_ms: i64,
    /// When it was finalized.
    pub finalized_at_ms: Option<i64>,
    /// Who registered it, as boards show it; empty where the service was open to everybody. Missing from reveals of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<String>,
    /// When all its answers were graded after that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completed_at_ms: Option<i64>,
}

/// An instance that was issued, with its grade.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedInstance {
    /// Its place in the order of issue, from 1.
    pub ordinal: i64,
    /// Its id.
    pub id: String,
    /// The entry that it belongs to.
    pub entry: String,
    /// The entrant's nonce.
    pub nonce: String,
    /// Run of the entry, from 1.
    pub run: u32,
    /// The family.
    pub family: String,
    /// Which of the family's instances in the run, from 0.
    pub index: u32,
    /// The specification issued.
    pub leaf: u32,
    /// SHA-256 of the log that answered it; null where none did.
    pub log_sha256: Option<String>,
    /// The verdict; null without an answer.
    pub overall: Option<bool>,
    /// Criterion and score of each check.
    pub scores: Option<Vec<(Criterion, f64)>>,
    /// What was promised of the agent's transcript.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transcript_sha256: Option<String>,
    /// Whether a transcript with that hash was shown.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub transcript_checked: bool,
}

/// All that an epoch held back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reveal {
    /// What was promised.
    pub commitment: Commitment,
    /// The key.
    pub key: String,
    /// All specifications, by leaf.
    pub specifications: Vec<RevealedSpecification>,
    /// All entries.
    pub entries: Vec<RevealedEntry>,
    /// All instances, in the order of issue.
    pub instances: Vec<RevealedInstance>,
    /// All receipts of the epoch, in the order of the log. Missing from reveals of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receipts: Option<Vec<ReceiptFile>>,
}

/// A specification as it is revealed.
#[must_use]
pub fn revealed(key: &EpochKey, specification: Specification) -> RevealedSpecification {
    let (salt, hash) = (salt(key, specification.leaf), leaf_hash(key, &specification));
    RevealedSpecification { salt: hex(&salt), hash: hex(&hash), specification }
}
