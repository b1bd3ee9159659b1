//! What an epoch publishes before it opens, and cannot change afterwards.

use serde::{Deserialize, Serialize};

use super::GENERATOR_VERSION;
use super::canonical::{Hash, hash_of};
use super::feedback::Feedback;
use super::merkle;
use super::pool::{Specification, Stratum};
use super::secret::EpochKey;
use crate::checks::CHECKS_VERSION;
use crate::tasks::hex;

/// The promise of an epoch. Hashes are lower-case hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Commitment {
    /// Name of the epoch.
    #[schema(example = "2026-11")]
    pub epoch: String,
    /// When it opens, milliseconds since 1970.
    pub opens_at_ms: i64,
    /// When it closes.
    pub closes_at_ms: i64,
    /// Version of the generator that drew its specifications.
    pub generator_version: u32,
    /// Version of the checks that grade.
    pub checks_version: u32,
    /// SHA-256 over a label and the key.
    pub key_hash: String,
    /// Root of the Merkle tree over the salted hashes of all specifications.
    pub root: String,
    /// How many specifications there are for each instance of a draw.
    pub per_instance: u32,
    /// Specifications in all.
    pub specifications: u32,
    /// Instances of one draw: what a run consists of.
    pub instances_per_run: u32,
    /// What entries of the dev tier are told after they are finalized.
    pub dev_feedback: Feedback,
    /// The rules; null for epochs made before rules were committed to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rules: Option<Rules>,
}

/// The rules that an epoch commits to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Rules {
    /// Seconds in which an instance is to be answered.
    pub instance_seconds: u32,
    /// Entries to the dev tier that one owner may register.
    pub dev_entries_per_owner: u32,
    /// Entries to the official tier that one owner may register.
    pub official_entries_per_owner: u32,
    /// Runs that one owner may hold, drawn or reserved, in both tiers.
    pub runs_per_owner: u32,
    /// Seconds for which a run that is not drawn keeps its part of the pool.
    pub reservation_seconds: u32,
    /// Bits of information that may be released before the epoch closes by itself.
    pub budget_bits: u32,
    /// The public key that signs receipts, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub receipt_key: String,
}

/// What is decided about an epoch when it is made.
#[derive(Debug, Clone)]
pub struct Terms {
    /// Name of the epoch.
    pub epoch: String,
    /// When it opens, milliseconds since 1970.
    pub opens_at_ms: i64,
    /// When it closes.
    pub closes_at_ms: i64,
    /// How many specifications there are for each instance of a draw.
    pub per_instance: u32,
    /// What entries of the dev tier are told.
    pub dev_feedback: Feedback,
    /// The rules.
    pub rules: Rules,
}

/// The salt of a leaf: keeps all from guessing a specification and comparing its hash.
#[must_use]
pub fn salt(key: &EpochKey, leaf: u32) -> Hash {
    key.derive("salt", &[&leaf.to_be_bytes()])
}

/// The leaf's hash: over its salt and the SHA-256 of the specification's canonical JSON.
#[must_use]
pub fn leaf_hash(key: &EpochKey, specification: &Specification) -> Hash {
    merkle::leaf(&salt(key, specification.leaf), &hash_of(specification))
}

impl Commitment {
    /// To a pool.
    #[must_use]
    pub fn to(terms: &Terms, key: &EpochKey, strata: &[Stratum], leaves: &[Hash]) -> Self {
        Self {
            epoch: terms.epoch.clone(),
            opens_at_ms: terms.opens_at_ms,
            closes_at_ms: terms.closes_at_ms,
            generator_version: GENERATOR_VERSION,
            checks_version: CHECKS_VERSION,
            key_hash: hex(&key.hash()),
            root: hex(&merkle::root(leaves)),
            per_instance: terms.per_instance,
            specifications: leaves.len() as u32,
            instances_per_run: strata.iter().map(|stratum| stratum.instances).sum(),
            dev_feedback: terms.dev_feedback,
            rules: Some(terms.rules.clone()),
        }
    }
}
