//! The pool of an epoch: all specifications that it can issue, made from its key, each certified by a reference build.
//!
//! A specification is drawn until it fits: its reference build is as large as the builds of the public families that it stands
//! for (half of the least to one and a half of the greatest), stands nowhere in the public suite, and passes every check. So
//! difficulty stays that of the public suite while no public instance returns.

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Serialize};

use super::canonical::{Hash, hash_of};
use super::secret::{Choices, EpochKey, first_number};
use crate::builders::{build, build_instance, equilibrium_stress_pa};
use crate::elasticity::Control;
use crate::grading::grade_log;
use crate::tasks::family::{Family, SuiteSource};
use crate::tasks::{Task, embedded, hidden};
use crate::voxel::{BlockLog, Cell, Event};

/// Name of hidden suites.
pub const HIDDEN: &str = "hidden";
/// Draws before a family is given up, which is a fault of its rules.
const MAX_DRAWS: u64 = 2_000;

/// Why there is no pool.
#[derive(Debug, thiserror::Error)]
pub enum PoolError {
    /// The files of a suite are faulty.
    #[error("the task files are faulty: {0}")]
    Files(String),
    /// Nothing new fits the rules of a family.
    #[error("the family {family:?} draws nothing new that fits: {last}")]
    Family {
        /// The family.
        family: String,
        /// What was wrong with the last draw.
        last: String,
    },
}

/// One specification of a pool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Specification {
    /// Its number in the pool, from 0: the leaf of the Merkle tree.
    pub leaf: u32,
    /// The task with its checks. What an agent sees of it are the prompts.
    pub task: Task,
}

/// A family's part of the pool.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stratum {
    /// The family.
    pub family: String,
    /// How many instances of it a draw holds.
    pub instances: u32,
    /// Its first leaf.
    pub first: u32,
    /// How many leaves it has.
    pub size: u32,
}

/// What a family stands for in the public suite, in blocks of reference builds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Volume {
    /// Of the smallest.
    pub least: usize,
    /// Of the largest.
    pub greatest: usize,
}

/// Makes specifications.
#[derive(Debug)]
pub struct Generator {
    source: SuiteSource,
    volumes: BTreeMap<String, Volume>,
    public_builds: HashSet<Hash, foldhash::fast::RandomState>,
}

/// Blocks that a log places.
#[must_use]
pub fn volume(log: &BlockLog) -> usize {
    log.event_count()
}

fn faulty(faults: &impl std::fmt::Debug) -> PoolError {
    PoolError::Files(format!("{faults:?}"))
}

impl Generator {
    /// Of this program's families, with the strata of its public suite.
    ///
    /// # Errors
    /// Where the files in this program are faulty; a test shows that they are not.
    pub fn new() -> Result<Self, PoolError> {
        let source = hidden::source().map_err(|faults| faulty(&faults))?;
        let public = embedded::latest().map_err(|faults| faulty(&faults))?;
        let mut volumes: BTreeMap<String, Volume> = BTreeMap::new();
        let mut public_builds = HashSet::default();
        for task in &public.tasks {
            let log = build(task).map_err(|error| PoolError::Files(error.to_string()))?;
            let blocks = volume(&log);
            let own = volumes.entry(task.family().to_owned()).or_insert(Volume { least: blocks, greatest: blocks });
            *own = Volume { least: own.least.min(blocks), greatest: own.greatest.max(blocks) };
            public_builds.insert(hash_of_build(&log));
        }
        Ok(Self { source, volumes, public_builds })
    }

    /// The families, in order.
    #[must_use]
    pub fn families(&self) -> &[Family] {
        &self.source.families
    }

    /// The builds that a family's may be as large as; none for a family that the public suite has nothing of.
    #[must_use]
    pub fn stratum_volume(&self, family: &Family) -> Option<Volume> {
        let rules = family.content.draw.as_ref()?;
        let own = rules.stands_for.iter().filter_map(|public| self.volumes.get(public));
        own.copied().reduce(|a, b| Volume { least: a.least.min(b.least), greatest: a.greatest.max(b.greatest) })
    }

    /// The strata of an epoch with so many specifications for each instance of a draw: all families that stand for public
    /// ones, and of the held-out ones the one that the key picks.
    #[must_use]
    pub fn strata(&self, key: &EpochKey, per_instance: u32) -> Vec<Stratum> {
        let weight = |family: &Family| family.content.draw.as_ref().map_or(0, |rules| rules.stands_for.len() as u32);
        let held_out: Vec<&Family> = self.families().iter().filter(|family| weight(family) == 0).collect();
        let picked = first_number(&key.derive("held-out", &[])) % held_out.len().max(1) as u64;
        let picked = held_out.get(picked as usize).map(|family| family.name());
        let mut first = 0;
        let taking = self.families().iter().filter(|family| weight(family) > 0 || picked == Some(family.name()));
        taking
            .map(|family| {
                let instances = weight(family).max(1);
                let stratum =
                    Stratum { family: family.name().to_owned(), instances, first, size: instances * per_instance };
                first += stratum.size;
                stratum
            })
            .collect()
    }

    /// The specifications of a family's part of the pool, by leaf; no two have the same parameters or the same prompts.
    /// `drawn` is told of each.
    ///
    /// # Errors
    /// Where nothing new that fits is drawn: a fault of the family's rules, or more is asked for than the family has.
    pub fn specifications(
        &self,
        key: &EpochKey,
        stratum: &Stratum,
        drawn: &dyn Fn(),
    ) -> Result<Vec<Specification>, PoolError> {
        let unknown = || PoolError::Files(format!("there is no hidden family {:?}", stratum.family));
        let family = self.source.family(&stratum.family).ok_or_else(unknown)?;
        let mut taken = HashSet::default();
        let mut specifications = Vec::with_capacity(stratum.size as usize);
        for leaf in stratum.first..stratum.first + stratum.size {
            specifications.push(self.specification(key, family, leaf, &mut taken)?);
            drawn();
        }
        Ok(specifications)
    }

    /// The specification of a leaf, of which nothing is taken yet.
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
                    let prompts: Vec<&str> = task.turns.iter().map(|turn| turn.prompt.as_str()).collect();
                    let own = [hash_of(&task.parameters), hash_of(&prompts)];
                    if own.iter().all(|hash| !taken.contains(hash)) {
                        taken.extend(own);
                        return Ok(Specification { leaf, task });
                    }
                    "another one of the pool is the same".clone_into(&mut last);
                }
                Err(Unfit::Again(why)) => last = why,
                Err(Unfit::Broken(error)) => return Err(error),
            }
        }
        Err(PoolError::Family { family: family.name().to_owned(), last })
    }

    /// One draw, with everything that it must fulfil.
    fn drawn(&self, family: &Family, leaf: u32, choices: &mut Choices<'_>) -> Result<Task, Unfit> {
        let broken = |faults| Unfit::Broken(faulty(&faults));
        let again = |why: &str| Unfit::Again(why.to_owned());
        let drawn = family.draw(&mut |n| choices.choose(n)).map_err(broken)?;
        let mut parameters = drawn.ok_or_else(|| again("its rules say to draw again"))?;
        let needs_reference = family.content.draw.as_ref().is_some_and(|rules| rules.needs_reference);
        // The number of turns comes with the wording; where a reference is needed there is one.
        let probe = build_instance(family.name(), &parameters, 1);
        let probe = probe.map_err(|error| Unfit::Broken(PoolError::Files(error.to_string())))?;
        if needs_reference {
            let stress = equilibrium_stress_pa(&probe, &Control::unhurried()).ok().flatten();
            let stress = stress.filter(|pa| *pa > 0.0).ok_or_else(|| again("the build has no equilibrium"))?;
            // To a hundredth of a pascal, so that the figure prints the same everywhere.
            parameters.insert("reference_pa".to_owned(), ((stress * 100.0).round() / 100.0).into());
        }
        let mut worded = family.tasks(&[parameters], 1, &self.source.words).map_err(broken)?;
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
            return Err(again("its build is larger or smaller than the public ones"));
        }
        if self.public_builds.contains(&hash_of_build(&log)) {
            return Err(again("the public suite has it"));
        }
        certify(&task, &log).map_err(Unfit::Again)?;
        Ok(task)
    }
}

/// Why a draw does not count.
enum Unfit {
    Again(String),
    Broken(PoolError),
}

/// What identifies a build: the blocks of every turn, whatever their order.
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

/// Whether a build passes every check of a task: a score of 1 for each.
///
/// # Errors
/// The first check that it does not pass, in words.
pub fn certify(task: &Task, log: &BlockLog) -> Result<(), String> {
    let report = grade_log(task, log, &Control::unhurried()).map_err(|_stopped| "grading was stopped".to_owned())?;
    let failed = report.turns.iter().flat_map(|turn| &turn.checks).find(|check| !check.finding.holds());
    failed.map_or(Ok(()), |check| Err(format!("{}: {}", check.name, check.finding.summary)))
}
