//! The commitment of an epoch: published before the epoch opens, and fixed from then on.

use serde::{Deserialize, Serialize};

use super::GENERATOR_VERSION;
use super::beacon::Beacon;
use super::canonical::{Hash, hash_of};
use super::draw_proof::public_key;
use super::feedback::{Counts, Feedback, Tier};
use super::ladder::Part;
use super::merkle;
use super::pool::{Specification, Stratum};
use super::secret::EpochKey;
use crate::checks::CHECKS_VERSION;
use crate::tasks::hex;
use crate::voxel::Profile;

/// The commitment of an epoch. Hashes are lower-case hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Commitment {
    /// Name of the epoch.
    #[schema(example = "2026-11")]
    pub epoch: String,
    /// Opening time, milliseconds since 1970.
    pub opens_at_ms: i64,
    /// Closing time, milliseconds since 1970.
    pub closes_at_ms: i64,
    /// Version of the generator that drew the specifications.
    pub generator_version: u32,
    /// Version of the checks that grade the answers.
    pub checks_version: u32,
    /// SHA-256 over a label and the epoch's key.
    pub key_hash: String,
    /// Public key of the epoch's draws: ECVRF-EDWARDS25519-SHA512-TAI (RFC 9381), in hex. Each draw carries a proof
    /// under it. Absent for epochs whose draws can be checked only after the reveal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub draw_key: Option<String>,
    /// Root of the Merkle tree over the salted hashes of all specifications. Absent for an epoch that is bound to a
    /// beacon, whose specifications nobody knows yet: the root is published with the pool, right after the round.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub root: Option<String>,
    /// The round of a public randomness beacon that the pool derives from, with the epoch's key. Absent for epochs
    /// whose operator knows the pool in advance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beacon: Option<Beacon>,
    /// Number of specifications in the pool for each instance of a draw.
    pub per_instance: u32,
    /// Total number of specifications in the pool.
    pub specifications: u32,
    /// Number of instances in one draw, that is, in one run.
    pub instances_per_run: u32,
    /// Feedback on entries of the dev tier after they are finalized.
    pub dev_feedback: Feedback,
    /// The rules; null for epochs from before commitments included rules.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rules: Option<Rules>,
    /// The list of public specifications from which each instance of the official tier has a sibling; absent for epochs
    /// without siblings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub siblings: Option<SiblingList>,
}

/// The public specifications that an epoch draws siblings from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SiblingList {
    /// Number of specifications in the list.
    pub specifications: u32,
    /// Root of the Merkle tree (RFC 6962) whose entries are the lines of the list, canonical JSON (RFC 8785) without
    /// line ends.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub root: String,
}

/// The rules that an epoch commits to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Rules {
    /// Time limit for answering an instance, in seconds.
    pub instance_seconds: u32,
    /// Maximum number of entries in the dev tier for each owner.
    pub dev_entries_per_owner: u32,
    /// Maximum number of entries in the official tier for each owner.
    pub official_entries_per_owner: u32,
    /// Maximum number of runs that one owner may hold, drawn or reserved, over both tiers.
    pub runs_per_owner: u32,
    /// Time for which an undrawn run keeps its reservation of the pool, in seconds.
    pub reservation_seconds: u32,
    /// Information budget in bits: the epoch closes automatically when its feedback has released this much.
    pub budget_bits: u32,
    /// The Ed25519 public key that verifies receipts, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub receipt_key: String,
    /// Profile of answers that name none; absent for `published`, which it was before profiles.
    #[serde(default, skip_serializing_if = "Profile::is_published")]
    pub profile: Profile,
    /// Version of the protocol. Since 2 a third of the instances of a dev entry is kept for the final board; absent for
    /// 1.
    #[serde(default = "first_protocol", skip_serializing_if = "is_first_protocol")]
    pub protocol: u32,
}

const fn first_protocol() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_first_protocol(protocol: &u32) -> bool {
    *protocol == first_protocol()
}

/// The choices made when an epoch is created.
#[derive(Debug, Clone)]
pub struct Terms {
    /// Name of the epoch.
    pub epoch: String,
    /// Opening time, milliseconds since 1970.
    pub opens_at_ms: i64,
    /// Closing time, milliseconds since 1970.
    pub closes_at_ms: i64,
    /// Number of specifications in the pool for each instance of a draw.
    pub per_instance: u32,
    /// Feedback on entries of the dev tier.
    pub dev_feedback: Feedback,
    /// The rules.
    pub rules: Rules,
    /// The beacon that the pool is bound to, if any.
    pub beacon: Option<Beacon>,
    /// The list that siblings are drawn from, if any.
    pub siblings: Option<SiblingList>,
}

/// Derives the salt of a leaf, which prevents anyone from guessing a specification and confirming it by its hash.
#[must_use]
pub fn salt(key: &EpochKey, leaf: u32) -> Hash {
    key.derive("salt", &[&leaf.to_be_bytes()])
}

/// Computes the hash of a leaf from its salt and the SHA-256 of the specification's canonical JSON.
#[must_use]
pub fn leaf_hash(key: &EpochKey, specification: &Specification) -> Hash {
    merkle::leaf(&salt(key, specification.leaf), &hash_of(specification))
}

/// Returns the root of the Merkle tree over the salted hashes of a pool's specifications, in hexadecimal.
#[must_use]
pub fn root_of(key: &EpochKey, specifications: &[Specification]) -> String {
    let leaves: Vec<Hash> = specifications.iter().map(|own| leaf_hash(key, own)).collect();
    hex(&merkle::root(&leaves))
}

impl Commitment {
    /// Creates the commitment to a key and to a pool of these strata. The root is that of its specifications, unless
    /// they derive from a beacon as well.
    #[must_use]
    pub fn to(terms: &Terms, key: &EpochKey, strata: &[Stratum], root: Option<String>) -> Self {
        Self {
            epoch: terms.epoch.clone(),
            opens_at_ms: terms.opens_at_ms,
            closes_at_ms: terms.closes_at_ms,
            generator_version: GENERATOR_VERSION,
            checks_version: CHECKS_VERSION,
            key_hash: hex(&key.hash()),
            draw_key: Some(public_key(key)),
            root,
            beacon: terms.beacon.clone(),
            per_instance: terms.per_instance,
            specifications: strata.iter().map(|stratum| stratum.size).sum(),
            instances_per_run: strata.iter().map(|stratum| stratum.instances).sum(),
            dev_feedback: terms.dev_feedback,
            rules: Some(terms.rules.clone()),
            siblings: terms.siblings.clone(),
        }
    }

    /// Returns the version of the epoch's protocol.
    #[must_use]
    pub fn protocol(&self) -> u32 {
        self.rules.as_ref().map_or(first_protocol(), |rules| rules.protocol)
    }

    /// Returns whether a leaf is one of the public list: those follow the leaves of the pool.
    #[must_use]
    pub const fn is_sibling(&self, leaf: u32) -> bool {
        leaf >= self.specifications
    }

    /// Returns what the outcome of an instance with this salt and leaf counts for in a tier.
    #[must_use]
    pub fn counts(&self, tier: Tier, salt: &str, leaf: u32) -> Counts {
        if self.is_sibling(leaf) {
            Counts::Sibling
        } else if tier == Tier::Dev && Part::of(self.protocol(), salt) == Part::Kept {
            Counts::Kept
        } else {
            Counts::Told
        }
    }
}
