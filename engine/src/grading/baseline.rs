//! What a log earns that does nothing: the scores that an empty log or a single block gets, so that a reward can begin above them.

use serde_json::Value;

use super::Report;
use crate::checks::{Check, Criterion, Subject};
use crate::elasticity::{Control, Stopped};
use crate::tasks::Task;
use crate::voxel::blocks::BlockSet;
use crate::voxel::{Cell, Structure};

/// Levels at which a single block is tried, beside those that a check names.
const LEVELS: [i32; 3] = [-1, 0, 1];
/// Checks from which a task is tried with stone alone, at the first levels.
const MANY_CHECKS: usize = 256;
/// Levels and materials taken from the arguments of a check at most.
const MOST_NAMED: usize = 8;

/// What an empty log scores on each check of a task, and the most that a single block earns beyond that.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// Scores of the empty structure, by turn and check.
    empty: Vec<Vec<f64>>,
    /// The most that a single block earns, in [0, 1].
    single: f64,
}

/// A score of a check, with what the empty structure scores on it.
type Scored = (Criterion, f64, f64);

impl Baseline {
    /// Of a task: its checks are put to the empty structure and to single blocks, of stone and of each material that they name, in the
    /// ground, on it, above it and at each level that they name.
    ///
    /// # Errors
    /// Only where `control` asked a long computation to end.
    pub fn of(task: &Task, control: &Control<'_>) -> Result<Self, Stopped> {
        let (mut materials, mut levels) = (vec!["stone".to_owned()], LEVELS.to_vec());
        for check in task.checks().filter(|check| !is_simulated(check)) {
            let data = serde_json::to_value(check).unwrap_or_default();
            name_all(&data["args"], &mut materials, &mut levels);
        }
        // A task of thousands of checks is tried with less, or it would take as long as all of them together.
        if task.checks().count() > MANY_CHECKS {
            materials.truncate(1);
            levels.truncate(LEVELS.len());
        }
        materials.sort_unstable();
        materials.dedup();
        levels.sort_unstable();
        levels.dedup();
        let empty = scores(task, &Structure::from_named([]), None, control)?;
        let mut baseline = Self { empty, single: 0.0 };
        // Of what a single block is, and where, is the same to its stress.
        let mut known = None;
        for (material, level) in
            materials.iter().flat_map(|material| levels.iter().map(move |level| (material, *level)))
        {
            let one = Structure::from_named([(Cell::new(0, level, 0), material.as_str())]);
            let single = scores(task, &one, known.as_ref(), control)?;
            let criteria = task.turns.iter().map(|turn| turn.checks.iter().map(Check::criterion));
            let scored = criteria.zip(&single).zip(&baseline.empty).flat_map(|((criteria, single), empty)| {
                criteria.zip(single).zip(empty).map(|((criterion, score), empty)| (criterion, *score, *empty))
            });
            baseline.single = baseline.single.max(earned(scored));
            known.get_or_insert(single);
        }
        Ok(baseline)
    }

    /// Whether a good build earns more than a log that does nothing.
    #[must_use]
    pub fn can_be_beaten(&self) -> bool {
        self.single < 1.0 && self.empty.iter().flatten().any(|empty| *empty < 1.0)
    }

    /// The shaped reward of a report on the same task, in [0, 1].
    ///
    /// A check on which an empty log scores *e* below 1 earns max(0, (*s* - *e*) / (1 - *e*)) for its score *s*. What a log earns is the
    /// mean over the criteria that have such checks, each the mean of its own, times the mean score of all other checks, those that an
    /// empty log passes. The most that a single block earns, *b*, is taken off: the reward is max(0, (earned - *b*) / (1 - *b*)), and 0
    /// where at most one block stands after every turn. It never falls where a check's score rises, and is 1 where all are 1.
    #[must_use]
    pub fn shaped(&self, report: &Report) -> f64 {
        if report.turns.iter().all(|turn| turn.blocks <= 1) {
            return 0.0;
        }
        let scored = report.turns.iter().zip(&self.empty).flat_map(|(turn, empty)| {
            turn.checks.iter().zip(empty).map(|(check, empty)| (check.criterion, check.finding.score, *empty))
        });
        ((earned(scored) - self.single) / (1.0 - self.single)).max(0.0)
    }
}

/// What scores earn beyond the empty structure's.
fn earned(scored: impl Iterator<Item = Scored>) -> f64 {
    let mut gains: Vec<(Criterion, f64, f64)> = Vec::new();
    let (mut kept, mut others) = (0.0, 0.0);
    for (criterion, score, empty) in scored {
        if empty >= 1.0 {
            (kept, others) = (kept + score, others + 1.0);
            continue;
        }
        let gain = ((score - empty) / (1.0 - empty)).max(0.0);
        match gains.iter_mut().find(|(own, ..)| *own == criterion) {
            Some((_, sum, count)) => (*sum, *count) = (*sum + gain, *count + 1.0),
            None => gains.push((criterion, gain, 1.0)),
        }
    }
    if gains.is_empty() {
        return 0.0;
    }
    let mean = gains.iter().map(|(_, sum, count)| sum / count).sum::<f64>() / gains.len() as f64;
    mean * if others > 0.0 { kept / others } else { 1.0 }
}

fn is_simulated(check: &Check) -> bool {
    check.criterion() == Criterion::StructuralStability
}

/// Scores of a structure that stands after every turn; those of simulations are taken from `known` where it is given.
fn scores(
    task: &Task,
    structure: &Structure,
    known: Option<&Vec<Vec<f64>>>,
    control: &Control<'_>,
) -> Result<Vec<Vec<f64>>, Stopped> {
    let subject = Subject { structure, control };
    let mut turns = Vec::with_capacity(task.turns.len());
    for (i, instruction) in task.turns.iter().enumerate() {
        let mut scores = Vec::with_capacity(instruction.checks.len());
        for (j, check) in instruction.checks.iter().enumerate() {
            if (control.stop)() {
                return Err(Stopped);
            }
            scores.push(match known {
                Some(known) if is_simulated(check) => known[i][j],
                _ => check.evaluate(&subject)?.score,
            });
        }
        turns.push(scores);
    }
    Ok(turns)
}

/// Adds the names and the levels that arguments hold.
fn name_all(args: &Value, materials: &mut Vec<String>, levels: &mut Vec<i32>) {
    match args {
        Value::String(name) if materials.len() <= MOST_NAMED => {
            let example = BlockSet::try_from(name.clone()).map(BlockSet::example);
            materials.push(example.map_or_else(|_| name.clone(), str::to_owned));
        }
        Value::Number(number) if levels.len() < LEVELS.len() + MOST_NAMED => {
            levels.extend(
                number.as_i64().and_then(|level| i32::try_from(level).ok()).filter(|level| level.abs() <= 2_000),
            );
        }
        Value::Array(items) => items.iter().for_each(|item| name_all(item, materials, levels)),
        Value::Object(members) => members.values().for_each(|member| name_all(member, materials, levels)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builders::build;
    use crate::builders::saboteurs::SABOTEURS;
    use crate::grading::grade_log;
    use crate::tasks::embedded;
    use crate::voxel::BlockLog;
    use std::collections::BTreeMap;

    /// One task of every family; `tests/hidden_checks.rs` has those that are hidden.
    fn one_of_each_family() -> Vec<Task> {
        let mut tasks: BTreeMap<String, Task> = BTreeMap::new();
        for task in embedded::latest().unwrap().tasks {
            tasks.entry(task.family().to_owned()).or_insert(task);
        }
        // Stress takes long and has its own tests.
        for task in tasks.values_mut() {
            for turn in &mut task.turns {
                turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
            }
        }
        tasks.into_values().collect()
    }

    fn shaped(task: &Task, log: &BlockLog) -> (f64, Report) {
        let report = grade_log(task, log, &Control::unhurried()).unwrap();
        (Baseline::of(task, &Control::unhurried()).unwrap().shaped(&report), report)
    }

    #[test]
    fn nothing_earns_nothing_and_a_good_build_all_in_every_family() {
        let tasks = one_of_each_family();
        assert!(tasks.len() > 20, "{}", tasks.len());
        for task in &tasks {
            let good = build(task).unwrap();
            assert_eq!(shaped(task, &good).0, 1.0, "{}", task.id);
            let nothing = BlockLog { turns: vec![Vec::new(); task.turns.len()], ..BlockLog::default() };
            assert_eq!(shaped(task, &nothing).0, 0.0, "{}", task.id);
            for material in ["stone", "oak_door", "red_bed", "oak_planks", "bedrock"] {
                for y in [-5, -1, 0, 1, 2, 4, 9] {
                    let mut log = nothing.clone();
                    log.add_event(0, Cell::new(3, y, -2), Some(material));
                    assert_eq!(shaped(task, &log).0, 0.0, "{}: {material} at {y}", task.id);
                }
            }
            // Something spoiled lies between, and every task can be shaped.
            assert!(Baseline::of(task, &Control::unhurried()).unwrap().can_be_beaten(), "{}", task.id);
            for saboteur in SABOTEURS {
                let (reward, report) = shaped(task, &saboteur.spoil(good.clone()));
                let is_whole =
                    report.turns.iter().flat_map(|turn| &turn.checks).all(|check| check.finding.score >= 1.0);
                assert!((0.0..=1.0).contains(&reward) && (reward >= 1.0) == is_whole, "{}: {reward}", task.id);
            }
        }
    }

    #[test]
    fn a_score_that_rises_never_lowers_the_reward() {
        for task in one_of_each_family() {
            let baseline = Baseline::of(&task, &Control::unhurried()).unwrap();
            let (_, mut report) = shaped(&task, &build(&task).unwrap());
            for turn in 0..report.turns.len() {
                for check in 0..report.turns[turn].checks.len() {
                    let mut before = -1.0;
                    for tenths in 0..=10 {
                        report.turns[turn].checks[check].finding.score = f64::from(tenths) / 10.0;
                        let reward = baseline.shaped(&report);
                        assert!(reward >= before, "{}", task.id);
                        before = reward;
                    }
                    // The next check is varied with this one half earned.
                    report.turns[turn].checks[check].finding.score = 0.5;
                }
            }
        }
    }
}
