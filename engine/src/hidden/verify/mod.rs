//! Verification of a reveal by anyone: recomputes specifications, root and draws from the key and grades from the logs,
//! and compares every step with the receipt that was signed when it happened.

mod board;
mod log;
mod pool;
mod stated;
mod steps;
mod times;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::GENERATOR_VERSION;
use super::beacon::BoundPool;
use super::canonical::{Hash, hash_of};
use super::commitment::{Commitment, salt};
use super::draw_proof::public_key;
use super::evidence::GivenReceipt;
use super::issue::Lot;
use super::merkle;
use super::pool::{Generator, PoolError, Specification};
use super::receipts::{LogHead, ReceiptFile};
use super::reveal::{Reveal, RevealedSpecification};
use super::secret::EpochKey;
use crate::checks::CHECKS_VERSION;
use crate::elasticity::Control;
use crate::grading::grade_log;
use crate::tasks::hex;
use crate::text::counted;
use crate::voxel::BlockLog;

/// A claim of the reveal that does not hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Breach {
    /// Subject of the breach: "key", "leaf 17 (slabs/00017)", "instance …".
    pub place: String,
    /// Description of the fault.
    pub detail: String,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.detail)
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
    /// Checks that could not be made, each with its reason.
    pub unchecked: Vec<String>,
    /// Claims that do not hold.
    pub breaches: Vec<Breach>,
}

impl Verified {
    pub(super) fn breach(&mut self, place: impl Into<String>, detail: impl Into<String>) {
        self.breaches.push(Breach { place: place.into(), detail: detail.into() });
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
    /// Public keys to trust in addition to the one in the commitment.
    pub keys: Vec<String>,
}

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
    let versions = [
        ("generator", commitment.generator_version, 1..=GENERATOR_VERSION),
        ("checks", commitment.checks_version, CHECKS_VERSION..=CHECKS_VERSION),
    ];
    for (what, theirs, ours) in versions {
        if !ours.contains(&theirs) {
            let detail = format!(
                "the epoch used version {theirs} of the {what}, this program has up to {}: verify with version {theirs}",
                ours.end()
            );
            found.breach(what, detail);
            return Ok(found);
        }
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
    if let Some(pool_key) = pool::key_of(reveal, commitment, kept, &key, &mut found) {
        specifications(reveal, commitment, &pool_key, &mut found)?;
        draws(reveal, commitment, &key, &pool_key, &mut found)?;
    } else if !reveal.instances.is_empty() {
        found.breach("draws", "instances were issued from a pool that cannot be recomputed");
    }
    match &kept.logs {
        Some(logs) => grades(reveal, logs, &mut found),
        None => found.unchecked.push("grades: no answers were given (--answers)".to_owned()),
    }
    steps::check(reveal, commitment, kept, &mut found);
    board::check(reveal, commitment, &key, &kept.boards, &mut found);
    Ok(found)
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

/// Checks that every instance is the one that key, entry and nonce draw, and that none was issued twice.
fn draws(
    reveal: &Reveal,
    commitment: &Commitment,
    key: &EpochKey,
    pool_key: &EpochKey,
    found: &mut Verified,
) -> Result<(), PoolError> {
    let strata = Generator::of(commitment.generator_version)?.strata(pool_key, commitment.per_instance);
    let mut issued: BTreeSet<u32> = BTreeSet::new();
    let mut lots: BTreeMap<(&str, u32, &str), Lot<'_>> = BTreeMap::new();
    let runs_of: BTreeMap<&str, u32> = reveal.entries.iter().map(|entry| (entry.id.as_str(), entry.runs)).collect();
    let mut drawn_for: BTreeMap<(&str, u32), BTreeSet<(&str, u32)>> = BTreeMap::new();
    let mut nonce_of: BTreeMap<(&str, u32), &str> = BTreeMap::new();
    let mut ids: BTreeSet<&str> = BTreeSet::new();
    for (ordinal, instance) in (1..).zip(&reveal.instances) {
        let place = || format!("instance {}", instance.id);
        let runs = runs_of.get(instance.entry.as_str()).copied().unwrap_or_default();
        if !(1..=runs).contains(&instance.run) {
            let runs = counted(runs, "run");
            found.breach(place(), format!("belongs to run {}, but its entry registered {runs}", instance.run));
        }
        let of_run = drawn_for.entry((&instance.entry, instance.run)).or_default();
        if !of_run.insert((&instance.family, instance.index)) {
            found.breach(place(), "has the family and index of an earlier instance of the same run");
        }
        if *nonce_of.entry((&instance.entry, instance.run)).or_insert(&instance.nonce) != instance.nonce {
            found.breach(place(), format!("run {} was drawn with more than one nonce", instance.run));
        }
        if !ids.insert(&instance.id) {
            found.breach(place(), "appears twice in the reveal");
        }
        if instance.ordinal != ordinal {
            found.breach(place(), format!("has the ordinal {}, but {ordinal} is next", instance.ordinal));
        }
        let Some(stratum) = strata.iter().find(|stratum| stratum.family == instance.family) else {
            found.breach(place(), format!("the epoch has no family {:?}", instance.family));
            continue;
        };
        let lot = lots
            .entry((&instance.entry, instance.run, &instance.nonce))
            .or_insert_with(|| Lot::of(commitment, key, &instance.entry, instance.run, &instance.nonce));
        let drawn = lot.leaf(stratum, instance.index, |leaf| issued.contains(&leaf));
        if drawn == Some(instance.leaf) {
            found.draws += 1;
        } else {
            found.breach(place(), format!("leaf {} was issued, but key and nonce draw {drawn:?}", instance.leaf));
        }
        issued.insert(instance.leaf);
    }
    // A draw always issues all instances of a run.
    for ((entry, run), of_run) in &drawn_for {
        let missing = strata.iter().flat_map(|own| (0..own.instances).map(move |index| (own.family.as_str(), index)));
        for (family, index) in missing.filter(|place| !of_run.contains(place)) {
            found.breach(format!("entry {entry}"), format!("run {run} lacks instance {index} of the family {family}"));
        }
        if of_run
            .iter()
            .any(|(family, index)| strata.iter().all(|own| own.family != *family || *index >= own.instances))
        {
            found.breach(format!("entry {entry}"), format!("run {run} has instances that no draw contains"));
        }
    }
    Ok(())
}

/// Checks that every grade is the one that this program computes for the log.
fn grades(reveal: &Reveal, logs: &BTreeMap<String, BlockLog>, found: &mut Verified) {
    let answered = |id: &String| reveal.instances.iter().any(|own| own.id == *id && own.log_sha256.is_some());
    for id in logs.keys().filter(|id| !answered(id)) {
        found.breach(format!("instance {id}"), "has a log among the answers but no answer in the reveal");
    }
    let tasks: BTreeMap<u32, &Specification> =
        reveal.specifications.iter().map(|revealed| (revealed.specification.leaf, &revealed.specification)).collect();
    for instance in &reveal.instances {
        let place = format!("instance {}", instance.id);
        let is_graded = instance.overall.is_some() || instance.scores.is_some();
        if instance.log_sha256.is_none() {
            if is_graded {
                found.breach(place, "has a grade but no answer");
            }
            continue;
        }
        // An answer that the service failed to grade has no grade and counts as failed.
        if !is_graded {
            found.ungraded += 1;
            continue;
        }
        let (Some(log), Some(specification)) = (logs.get(&instance.id), tasks.get(&instance.leaf)) else {
            found.breach(place, "its log is missing from the answers, or its specification from the reveal");
            continue;
        };
        let hash = hex(&Sha256::digest(log.canonical_json()));
        if Some(&hash) != instance.log_sha256.as_ref() {
            found.breach(place, format!("the log has the hash {hash}, which is not the one in the reveal"));
            continue;
        }
        let Ok(report) = grade_log(&specification.task, log, &Control::unhurried()) else { continue };
        let is_same = Some(report.overall) == instance.overall && Some(report.scores().rows) == instance.scores;
        if is_same {
            found.grades += 1;
        } else {
            let detail = format!(
                "its verdict ({:?}) or a score differs from what this program finds ({})",
                instance.overall, report.overall
            );
            found.breach(place, detail);
        }
    }
}
