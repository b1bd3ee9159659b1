//! The reveal of an epoch: everything that the service withheld while the epoch was open, published when it is over.

use serde::{Deserialize, Serialize};

use super::beacon::BoundPool;
use super::commitment::{Commitment, leaf_hash, salt};
use super::feedback::Tier;
use super::pool::Specification;
use super::receipts::ReceiptFile;
use super::secret::EpochKey;
use crate::checks::Criterion;
use crate::tasks::hex;

/// A specification with the salt and hash of its leaf.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedSpecification {
    /// Salt of the leaf, in hex.
    pub salt: String,
    /// Hash of the leaf, in hex.
    pub hash: String,
    /// The specification.
    #[serde(flatten)]
    pub specification: Specification,
}

/// An entry of the epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedEntry {
    /// Identifier of the entry.
    pub id: String,
    /// Name of the evaluated agent.
    pub agent: String,
    /// SHA-256 of the agent's configuration, as registered.
    pub configuration_hash: String,
    /// Tier of the entry.
    pub tier: Tier,
    /// Number of registered runs.
    pub runs: u32,
    /// Time of registration, milliseconds since 1970.
    pub registered_at_ms: i64,
    /// Time of finalization, milliseconds since 1970.
    pub finalized_at_ms: Option<i64>,
    /// Owner that registered the entry, as boards show it; empty if the service was open to everyone. Missing from
    /// reveals of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<String>,
    /// Time of completion after that, when all answers were graded, milliseconds since 1970.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completed_at_ms: Option<i64>,
}

/// An issued instance with its grade.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevealedInstance {
    /// Position in the order of issue, from 1.
    pub ordinal: i64,
    /// Identifier of the instance.
    pub id: String,
    /// Identifier of the entry to which the instance belongs.
    pub entry: String,
    /// The entrant's nonce.
    pub nonce: String,
    /// Number of the entry's run, from 1.
    pub run: u32,
    /// Name of the family.
    pub family: String,
    /// Index among the family's instances in the run, from 0; a sibling has that of its instance plus their number.
    pub index: u32,
    /// Leaf of the issued specification. From the number of specifications in the pool on it is a sibling: plus its
    /// leaf in the public list, plus the length of the list for each time that it was issued before.
    pub leaf: u32,
    /// SHA-256 of the answer's block log; null without an answer.
    pub log_sha256: Option<String>,
    /// Whether the answer passes; null without a grade.
    pub overall: Option<bool>,
    /// Criterion and score of each check; null without a grade.
    pub scores: Option<Vec<(Criterion, f64)>>,
    /// Promised SHA-256 of the agent's transcript, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transcript_sha256: Option<String>,
    /// Whether a transcript with the promised hash was shown.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub transcript_checked: bool,
}

/// Everything that an epoch withheld until its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reveal {
    /// The commitment that was published before the epoch opened.
    pub commitment: Commitment,
    /// The epoch's secret key, in hex.
    pub key: String,
    /// The pool as it was published right after the round, if the epoch is bound to a beacon and the round came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pool: Option<BoundPool>,
    /// All specifications of the pool, by leaf.
    pub specifications: Vec<RevealedSpecification>,
    /// All entries.
    pub entries: Vec<RevealedEntry>,
    /// All instances, in the order of issue.
    pub instances: Vec<RevealedInstance>,
    /// All receipts of the epoch, in the order of the public log. Missing from reveals of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receipts: Option<Vec<ReceiptFile>>,
}

/// Returns a specification with the salt and hash of its leaf, as in the reveal. The key is that of the pool.
#[must_use]
pub fn revealed(key: &EpochKey, specification: Specification) -> RevealedSpecification {
    let (salt, hash) = (salt(key, specification.leaf), leaf_hash(key, &specification));
    RevealedSpecification { salt: hex(&salt), hash: hex(&hash), specification }
}
