//! The pool of an epoch: all specifications that it can issue, derived from its key, each certified by a reference
//! build.
//!
//! Each specification is redrawn until it fits: the size of its reference build is in the range of the public families
//! that it stands for (half of the smallest to one and a half times the largest), the public suite does not contain
//! that build, no known specification (a sibling) has its parameters or its prompts, and the build passes every check.
//! The difficulty therefore stays that of the public suite, and no public instance returns.

use std::collections::{BTreeMap, HashSet};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::canonical::{Hash, hash_of};
use super::secret::{Choices, EpochKey, first_number};
use crate::builders::{build, build_instance, equilibrium_stress_pa};
use crate::elasticity::Control;
use crate::grading::grade_log;
use crate::tasks::family::{Family, SuiteSource};
use crate::tasks::{Task, embedded, hidden};
use crate::voxel::{BlockLog, Cell, Event};

/// Name of the hidden suites.
pub const HIDDEN: &str = "hidden";
/// Number of draws after which the generator gives up on a family; needing that many is a fault of the family's rules.
const MAX_DRAWS: u64 = 2_000;

/// The reason why a pool cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PoolError {
    /// The task files of a suite are faulty.
    #[error("the task files are faulty: {0}")]
    Files(String),
    /// No draw of a family is new and fits its rules.
    #[error("the family {family:?} draws no new specification that fits; reason at the last draw: {last}")]
    Family {
        /// Name of the family.
        family: String,
        /// Reason why the last draw did not fit.
        last: String,
    },
}

/// One specification of a pool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Specification {
    /// Index in the pool, from 0, which is the leaf of the Merkle tree.
    pub leaf: u32,
    /// The task with its checks. Agents see only its prompts.
    pub task: Task,
}

/// The part of the pool that belongs to one family.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stratum {
    /// Name of the family.
    pub family: String,
    /// Number of the family's instances in a draw.
    pub instances: u32,
    /// First leaf of the stratum.
    pub first: u32,
    /// Number of leaves in the stratum.
    pub size: u32,
}

/// The range of sizes of reference builds in the public suite, as measured by [`volume`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Volume {
    /// Size of the smallest build.
    pub least: usize,
    /// Size of the largest build.
    pub greatest: usize,
}

/// Generates the specifications of a pool.
#[derive(Debug)]
pub struct Generator {
    /// Version of the hidden suite.
    suite: u32,
    source: SuiteSource,
    volumes: BTreeMap<String, Volume>,
    public_builds: HashSet<Hash, foldhash::fast::RandomState>,
    /// Marks of known specifications, by family, which are not drawn either.
    known_marks: BTreeMap<String, Vec<Hash>>,
}

/// Returns the version of the hidden suite from which a version of the generator draws.
pub(super) fn suite_of(version: u32) -> Result<u32, PoolError> {
    match version {
        1 => Ok(1),
        2 | 3 => Ok(2),
        4 => Ok(3),
        _ => Err(PoolError::Files(format!("there is no version {version} of the generator"))),
    }
}

/// Returns the size of a build: the number of events in its log.
#[must_use]
pub fn volume(log: &BlockLog) -> usize {
    log.event_count()
}

/// Returns the number of public families that a family stands for: 0 for a held-out one.
fn weight(family: &Family) -> u32 {
    family.content.draw.as_ref().map_or(0, |rules| rules.stands_for.len() as u32)
}

/// Returns a stratum for each family. Each begins at the leaf after the last one of the stratum before it.
pub(super) fn strata_of<'a>(families: impl Iterator<Item = &'a Family>, per_instance: u32) -> Vec<Stratum> {
    let mut first = 0;
    let stratum = |family: &Family| {
        let instances = weight(family).max(1);
        let own = Stratum { family: family.name().to_owned(), instances, first, size: instances * per_instance };
        first += own.size;
        own
    };
    families.map(stratum).collect()
}

fn faulty(faults: &impl std::fmt::Debug) -> PoolError {
    PoolError::Files(format!("{faults:?}"))
}

impl Generator {
    /// Returns the generator of a version of the hidden suite, which does not know the list of siblings. A program
    /// creates each once, which builds the public suites.
    ///
    /// # Errors
    /// Returns an error if there is no such version, or the embedded files are faulty; a test shows that they are not.
    pub(super) fn of_suite(suite: u32) -> Result<&'static Self, PoolError> {
        static CREATED: [OnceLock<Generator>; hidden::LATEST as usize] = [const { OnceLock::new() }; _];
        let place = suite.checked_sub(1).and_then(|place| CREATED.get(place as usize));
        let place =
            place.ok_or_else(|| PoolError::Files(format!("there is no version {suite} of the hidden suite")))?;
        if let Some(created) = place.get() {
            return Ok(created);
        }
        let created = Self::create(suite, &[])?;
        Ok(place.get_or_init(|| created))
    }

    /// Creates the generator of a version of the hidden suite. It draws none of the `known` specifications.
    pub(super) fn create(suite: u32, known: &[Specification]) -> Result<Self, PoolError> {
        let source = hidden::source(suite).map_err(|faults| faulty(&faults))?;
        let mut volumes: BTreeMap<String, Volume> = BTreeMap::new();
        let mut public_builds = HashSet::default();
        // Builds of earlier versions of the public suite are known as well; sizes are compared with the latest alone.
        for public in 2..=suite + 1 {
            for task in embedded::suite(public).map_err(|faults| faulty(&faults))?.tasks {
                let log = build(&task).map_err(|error| PoolError::Files(error.to_string()))?;
                public_builds.insert(hash_of_build(&log));
                if public == suite + 1 {
                    let blocks = volume(&log);
                    let fresh = Volume { least: blocks, greatest: blocks };
                    let own = volumes.entry(task.family().to_owned()).or_insert(fresh);
                    *own = Volume { least: own.least.min(blocks), greatest: own.greatest.max(blocks) };
                }
            }
        }
        let mut known_marks: BTreeMap<String, Vec<Hash>> = BTreeMap::new();
        for own in known {
            known_marks.entry(own.task.family().to_owned()).or_default().extend(marks_of(&own.task));
        }
        Ok(Self { suite, source, volumes, public_builds, known_marks })
    }

    /// Returns the hidden families, in order.
    #[must_use]
    pub fn families(&self) -> &[Family] {
        &self.source.families
    }

    /// Returns the range of sizes over the public families that a family stands for, or `None` if it stands for none.
    #[must_use]
    pub fn stratum_volume(&self, family: &Family) -> Option<Volume> {
        let rules = family.content.draw.as_ref()?;
        let own = rules.stands_for.iter().filter_map(|public| self.volumes.get(public));
        own.copied().reduce(|a, b| Volume { least: a.least.min(b.least), greatest: a.greatest.max(b.greatest) })
    }

    /// Returns the strata of an epoch that has `per_instance` specifications for each instance of a draw: one for each
    /// family that stands for public families, and one for the held-out family that the key selects.
    #[must_use]
    pub fn strata(&self, key: &EpochKey, per_instance: u32) -> Vec<Stratum> {
        let held_out: Vec<&Family> = self.families().iter().filter(|family| weight(family) == 0).collect();
        let picked = first_number(&key.derive("held-out", &[])) % held_out.len().max(1) as u64;
        let picked = held_out.get(picked as usize).map(|family| family.name());
        let taking = self.families().iter().filter(|family| weight(family) > 0 || picked == Some(family.name()));
        strata_of(taking, per_instance)
    }

    /// Generates the specifications of a stratum, by leaf; no two have the same parameters or the same prompts. Calls
    /// `drawn` after each one.
    ///
    /// # Errors
    /// Returns an error if no new specification fits: the family's rules are faulty, or the stratum needs more
    /// specifications than the family has. Also fails if the task files are faulty or the family is unknown.
    pub fn specifications(
        &self,
        key: &EpochKey,
        stratum: &Stratum,
        drawn: &dyn Fn(),
    ) -> Result<Vec<Specification>, PoolError> {
        let unknown = || PoolError::Files(format!("there is no hidden family {:?}", stratum.family));
        let family = self.source.family(&stratum.family).ok_or_else(unknown)?;
        let mut taken: HashSet<Hash, foldhash::fast::RandomState> = HashSet::default();
        taken.extend(self.known_marks.get(&stratum.family).into_iter().flatten());
        let mut specifications = Vec::with_capacity(stratum.size as usize);
        for leaf in stratum.first..stratum.first + stratum.size {
            specifications.push(self.specification(key, family, leaf, &mut taken)?);
            drawn();
        }
        Ok(specifications)
    }

    /// Generates the specification of a leaf, with parameters and prompts that are not in `taken`, and adds them to it.
    fn specification(
        &self,
        key: &EpochKey,
        family: &Family,
        leaf: u32,
        taken: &mut HashSet<Hash, foldhash::fast::RandomState>,
    ) -> Result<Specification, PoolError> {
        let mut last = "nothing was drawn".to_owned();
        for draw in 0..MAX_DRAWS {
            let parts = [family.name().as_bytes(), &leaf.to_be_bytes(), &draw.to_be_bytes()];
            let mut choices = Choices::new(key, "specification", &parts);
            match self.drawn(family, leaf, &mut choices) {
                Ok(task) => {
                    let own = marks_of(&task);
                    if own.iter().all(|hash| !taken.contains(hash)) {
                        taken.extend(own);
                        return Ok(Specification { leaf, task });
                    }
                    "the pool or the list of siblings already has its parameters or its prompts".clone_into(&mut last);
                }
                Err(Unfit::Again(why)) => last = why,
                Err(Unfit::Broken(error)) => return Err(error),
            }
        }
        Err(PoolError::Family { family: family.name().to_owned(), last })
    }

    /// Draws one task and checks every condition that it must meet.
    fn drawn(&self, family: &Family, leaf: u32, choices: &mut Choices<'_>) -> Result<Task, Unfit> {
        let broken = |faults| Unfit::Broken(faulty(&faults));
        let again = |why: &str| Unfit::Again(why.to_owned());
        let drawn = family.draw(&mut |n| choices.choose(n)).map_err(broken)?;
        let mut parameters = drawn.ok_or_else(|| again("the family's rules reject it"))?;
        let needs_reference = family.content.draw.as_ref().is_some_and(|rules| rules.needs_reference);
        // The wording determines the number of turns; a family that needs a reference has a single turn.
        let probe = build_instance(family.name(), &parameters, 1);
        let probe = probe.map_err(|error| Unfit::Broken(PoolError::Files(error.to_string())))?;
        if needs_reference {
            let stress = equilibrium_stress_pa(&probe, &Control::unhurried()).ok().flatten();
            let stress = stress.filter(|pa| *pa > 0.0).ok_or_else(|| again("the build has no equilibrium"))?;
            // Rounded to a hundredth of a pascal, so that the value prints the same everywhere.
            parameters.insert("reference_pa".to_owned(), ((stress * 100.0).round() / 100.0).into());
        }
        let edition = self.source.edition(self.suite).map_err(broken)?;
        let mut worded = family.tasks(&[parameters], &edition).map_err(broken)?;
        if worded.is_empty() {
            return Err(again("no wording fits"));
        }
        let mut task = worded.swap_remove(choices.choose(worded.len() as u64) as usize);
        task.id = format!("{}/{leaf:05}", family.name());
        task.number = leaf + 1;
        let log = build(&task).map_err(|error| Unfit::Broken(PoolError::Files(error.to_string())))?;
        if let Some(range) = self.stratum_volume(family)
            && !(range.least.div_ceil(2)..=range.greatest + range.greatest / 2).contains(&volume(&log))
        {
            return Err(again("the build is too small or too large beside the public ones"));
        }
        if self.public_builds.contains(&hash_of_build(&log)) {
            return Err(again("the public suite already has this build"));
        }
        certify(&task, &log).map_err(Unfit::Again)?;
        Ok(task)
    }
}

/// The reason why a draw is rejected.
enum Unfit {
    Again(String),
    Broken(PoolError),
}

/// Computes the hashes that no two tasks of a family share: of the parameters, and of the prompts.
fn marks_of(task: &Task) -> [Hash; 2] {
    let prompts: Vec<&str> = task.turns.iter().map(|turn| turn.prompt.as_str()).collect();
    [hash_of(&task.parameters), hash_of(&prompts)]
}

/// Computes the hash that identifies a build: over the blocks of every turn, regardless of their order.
fn hash_of_build(log: &BlockLog) -> Hash {
    let mut blocks: Vec<(usize, Cell, &str)> = Vec::with_capacity(log.event_count());
    for (turn, events) in log.turns.iter().enumerate() {
        let name = |event: &Event| match *event {
            Event::Place { material, .. } => log.palette.name(material),
            Event::Remove { .. } => "",
        };
        blocks.extend(events.iter().map(|event| (turn, event.cell(), name(event))));
    }
    blocks.sort_unstable();
    hash_of(&blocks)
}

/// Checks that a build passes every check of a task with a score of 1.
///
/// # Errors
/// Returns the name and the summary of the first check that does not pass.
pub fn certify(task: &Task, log: &BlockLog) -> Result<(), String> {
    let report = grade_log(task, log, &Control::unhurried()).map_err(|_stopped| "grading was stopped".to_owned())?;
    let failed = report.turns.iter().flat_map(|turn| &turn.checks).find(|check| !check.finding.holds());
    failed.map_or(Ok(()), |check| Err(format!("{}: {}", check.name, check.finding.summary)))
}
