//! Verification of a reveal by anyone: recomputes specifications, root and draws from the key and grades from the logs,
//! and compares every step with the receipt that was signed when it happened.

mod board;
mod draws;
mod grades;
mod issued;
mod log;
mod places;
mod pool;
mod stated;
mod steps;
mod times;

use std::collections::BTreeMap;
use std::fmt;

use serde_json::Value;

use super::beacon::BoundPool;
use super::canonical::{Hash, hash_of};
use super::commitment::{Commitment, salt};
use super::draw_proof::public_key;
use super::evidence::GivenReceipt;
use super::issue::Drawing;
use super::merkle;
use super::pool::{Generator, PoolError};
use super::receipts::{LogHead, ReceiptFile};
use super::reveal::{Reveal, RevealedSpecification};
use super::secret::EpochKey;
use super::siblings::{FIRST_WITH_SIBLINGS, Siblings};
use super::{FIRST_WITH_KEPT_PART, GENERATOR_VERSION, PROTOCOL};
use crate::checks::CHECKS_VERSION;
use crate::tasks::hex;
use crate::voxel::BlockLog;
use issued::Issued;

/// A claim of the reveal that does not hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Breach {
    /// Subject of the breach: "key", "leaf 17 (slabs/00017)", "instance …".
    pub subject: String,
    /// Description of the fault.
    pub detail: String,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.subject, self.detail)
    }
}

/// The result of a verification.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verified {
    /// Number of specifications that were recomputed from the key and match.
    pub specifications: usize,
    /// Number of draws that were recomputed and match.
    pub draws: usize,
    /// Number of grades that were recomputed from the logs and match.
    pub grades: usize,
    /// Number of answers that the service failed to grade; they count as failed.
    pub ungraded: usize,
    /// Number of receipts of the epoch, if all of them verify and agree with the reveal; otherwise 0.
    pub receipts: usize,
    /// Number of boards that were recomputed and match.
    pub boards: usize,
    /// What breaks no promise, and what readers should know of.
    pub remarks: Vec<String>,
    /// Checks that could not be made, each with its reason.
    pub unchecked: Vec<String>,
    /// Claims that do not hold.
    pub breaches: Vec<Breach>,
    /// Reason why this program cannot recompute the epoch; none of the counts says anything then.
    pub unverifiable: Option<String>,
}

impl Verified {
    pub(super) fn breach(&mut self, subject: impl Into<String>, detail: impl Into<String>) {
        self.breaches.push(Breach { subject: subject.into(), detail: detail.into() });
    }
}

/// The evidence that a reveal is compared with.
#[derive(Debug, Default)]
pub struct Kept {
    /// Commitment as published before the epoch opened; the one in the reveal is used if this is `None`.
    pub commitment: Option<Commitment>,
    /// Pool as published right after the round of the epoch's beacon.
    pub pool: Option<BoundPool>,
    /// Answers by instance; `None` if grades are not to be checked.
    pub logs: Option<BTreeMap<String, BlockLog>>,
    /// Receipts of the public log, or of parts of it.
    pub log: Vec<ReceiptFile>,
    /// Signed heads of the public log.
    pub heads: Vec<LogHead>,
    /// Receipts that entrants received from the service.
    pub given: Vec<GivenReceipt>,
    /// Boards of the epoch as the service shows them.
    pub boards: Vec<Value>,
    /// Whether the boards were fetched after the reveal, so that they must be final.
    pub boards_follow_reveal: bool,
    /// Public keys to trust in addition to the one in the commitment.
    pub keys: Vec<String>,
}

/// Most specifications for each instance of a draw; no program has announced more.
const MAX_PER_INSTANCE: u32 = 1_000;

/// Verifies a reveal: recomputes everything from the key, and compares every step with its receipt.
///
/// # Errors
/// Returns an error if this program's own families are faulty.
pub fn verify(reveal: &Reveal, kept: &Kept) -> Result<Verified, PoolError> {
    let mut found = Verified::default();
    let commitment = kept.commitment.as_ref().unwrap_or(&reveal.commitment);
    if kept.commitment.as_ref().is_some_and(|promised| *promised != reveal.commitment) {
        found.breach("commitment", "the revealed one is not the one that was published before the epoch opened");
    }
    if let Some(why) = foreign_version(commitment) {
        found.unverifiable = Some(why);
        return Ok(found);
    }
    if !(1..=MAX_PER_INSTANCE).contains(&commitment.per_instance) {
        let theirs = commitment.per_instance;
        found.breach(
            "commitment",
            format!("{theirs} specifications for each instance; 1 to {MAX_PER_INSTANCE} are possible"),
        );
        return Ok(found);
    }
    let Some(key) = EpochKey::from_hex(&reveal.key) else {
        found.breach("key", "is not 32 bytes of hexadecimal");
        return Ok(found);
    };
    if hex(&key.hash()) != commitment.key_hash {
        found.breach("key", format!("its hash is {}, the commitment has {}", hex(&key.hash()), commitment.key_hash));
        return Ok(found);
    }
    if commitment.draw_key.as_ref().is_some_and(|committed| *committed != public_key(&key)) {
        found.breach("draw key", "the committed key of draws does not follow from the epoch's key");
    }
    let issued = Issued::of(reveal, commitment)?;
    if let Some(pool_key) = pool::key_of(reveal, commitment, kept, &key, &mut found) {
        specifications(reveal, commitment, &pool_key, &mut found)?;
        let strata = Generator::of(commitment.generator_version)?.strata(&pool_key, commitment.per_instance);
        let drawing = Drawing { commitment, strata: &strata, siblings: issued.siblings };
        draws::check(reveal, &drawing, &key, &mut found);
    } else if !reveal.instances.is_empty() {
        found.breach("draws", "instances were issued from a pool that cannot be recomputed");
    }
    if commitment.siblings.as_ref() != issued.siblings.map(Siblings::list) {
        found.breach("siblings", "the committed list is not the public one of this version of the generator");
    }
    if commitment.siblings.is_some() && commitment.generator_version < FIRST_WITH_SIBLINGS {
        found.breach("siblings", "this version of the generator may draw siblings as hidden instances");
    }
    if commitment.generator_version >= FIRST_WITH_SIBLINGS && commitment.protocol() < FIRST_WITH_KEPT_PART {
        let why = format!(
            "the protocol: the epoch has version {}, though programs with its generator announce epochs with {FIRST_WITH_KEPT_PART} or more",
            commitment.protocol()
        );
        found.unchecked.push(why);
    }
    match &kept.logs {
        Some(logs) => grades::check(reveal, logs, &issued, &mut found),
        None => found.unchecked.push("grades: no answers were given (--answers)".to_owned()),
    }
    steps::check(reveal, commitment, kept, &issued, &mut found);
    board::check(reveal, commitment, &key, kept, &mut found);
    Ok(found)
}

/// Returns why this program cannot recompute an epoch that another version of the rules made. That breaks no promise.
fn foreign_version(commitment: &Commitment) -> Option<String> {
    let versions = [
        ("generator", commitment.generator_version, 1..=GENERATOR_VERSION),
        ("checks", commitment.checks_version, CHECKS_VERSION..=CHECKS_VERSION),
        ("protocol", commitment.protocol(), 1..=PROTOCOL),
    ];
    let (what, theirs, ours) = versions.into_iter().find(|(_, theirs, ours)| !ours.contains(theirs))?;
    let ours = if ours.start() == ours.end() {
        format!("version {} alone", ours.end())
    } else {
        format!("versions {} to {}", ours.start(), ours.end())
    };
    Some(format!(
        "the epoch has version {theirs} of the {what}, and this program has {ours}: verify it with a release that has version {theirs}"
    ))
}

/// Checks that every specification follows from the key and that their root is the one in the commitment.
fn specifications(
    reveal: &Reveal,
    commitment: &Commitment,
    key: &EpochKey,
    found: &mut Verified,
) -> Result<(), PoolError> {
    let mut leaves: Vec<Hash> = Vec::new();
    let by_leaf: BTreeMap<u32, &RevealedSpecification> =
        reveal.specifications.iter().map(|revealed| (revealed.specification.leaf, revealed)).collect();
    let generator = Generator::of(commitment.generator_version)?;
    let mut drawn = Vec::new();
    for stratum in generator.strata(key, commitment.per_instance) {
        drawn.extend(generator.specifications(key, &stratum, &|| ())?);
    }
    for made in drawn {
        let leaf = made.leaf;
        let place = || format!("leaf {leaf} ({})", made.task.id);
        let Some(revealed) = by_leaf.get(&leaf) else {
            found.breach(place(), "is missing from the reveal");
            continue;
        };
        let hash = merkle::leaf(&salt(key, leaf), &hash_of(&revealed.specification));
        if revealed.specification != made {
            found.breach(place(), "the revealed specification is not the one that the key draws");
        } else if hex(&hash) != revealed.hash || revealed.salt != hex(&salt(key, leaf)) {
            found.breach(place(), "the salt or the hash does not match the specification");
        } else {
            found.specifications += 1;
        }
        leaves.push(hash);
    }
    if by_leaf.len() != leaves.len() || reveal.specifications.len() != leaves.len() {
        let count = reveal.specifications.len();
        found.breach("specifications", format!("the reveal has {count}, the key draws {}", leaves.len()));
    }
    let per_run: u32 = generator.strata(key, commitment.per_instance).iter().map(|own| own.instances).sum();
    if commitment.instances_per_run != per_run {
        let theirs = commitment.instances_per_run;
        found.breach("commitment", format!("states {theirs} instances in a run, the key draws {per_run}"));
    }
    if commitment.specifications as usize != leaves.len() {
        let detail = format!("the commitment states {}, the key draws {}", commitment.specifications, leaves.len());
        found.breach("specifications", detail);
    }
    let root = hex(&merkle::root(&leaves));
    // A beacon's epoch commits to its root when the pool is made.
    let committed = commitment.root.as_ref().or(reveal.pool.as_ref().map(|pool| &pool.root));
    if committed != Some(&root) {
        let committed = committed.map_or("none", String::as_str);
        found.breach("root", format!("the specifications give {root}, the commitment has {committed}"));
    }
    Ok(())
}
