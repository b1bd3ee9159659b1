//! Baselines: what an empty log or a single block earns on a task. The shaped reward begins above it.

use serde_json::Value;

use super::Scores;
use crate::checks::{Check, Criterion, Subject};
use crate::elasticity::{Control, Stopped};
use crate::tasks::Task;
use crate::voxel::blocks::BlockSet;
use crate::voxel::{Cell, Profile, Structure};

/// Levels at which a single block is tried, in addition to those that checks name.
const LEVELS: [i32; 3] = [-1, 0, 1];
/// Number of checks above which a task is tried with stone only, at [`LEVELS`] only.
const MANY_CHECKS: usize = 256;
/// Greatest number of different materials, and of different levels, taken from the arguments of a task's checks.
const MAX_NAMED: usize = 8;

/// The scores of an empty log on each check of a task, and the most that a single block earns beyond them.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// Scores of the empty structure, by turn and check.
    empty: Vec<Vec<f64>>,
    /// The most that a single block earns, in [0, 1].
    single: f64,
}

/// Criterion of a check, its score, and the score of the empty structure on it.
type Scored = (Criterion, f64, f64);

impl Baseline {
    /// Computes the baseline of a task. Evaluates its checks on the empty structure and on single blocks, of stone and
    /// of each material that the checks name, in the ground, on it, above it, and at each level that the checks name.
    ///
    /// # Errors
    /// Returns an error only if `control` stops a long computation.
    pub fn of(task: &Task, control: &Control<'_>) -> Result<Self, Stopped> {
        let (mut materials, mut levels) = (vec!["stone".to_owned()], LEVELS.to_vec());
        for check in task.checks().filter(|check| !is_simulated(check)) {
            let data = serde_json::to_value(check).expect("a check is JSON");
            name_all(&data["args"], &mut materials, &mut levels);
        }
        // Trying every material and level takes too long for a task of thousands of checks.
        if task.checks().count() > MANY_CHECKS {
            materials.truncate(1);
            levels.truncate(LEVELS.len());
        }
        materials.sort_unstable();
        levels.sort_unstable();
        let empty = scores(task, &Structure::from_named([]), None, control)?;
        let mut baseline = Self { empty, single: 0.0 };
        // The stress of a single block depends on neither its material nor its level.
        let mut known = None;
        for (material, level) in
            materials.iter().flat_map(|material| levels.iter().map(move |level| (material, *level)))
        {
            let one = Structure::from_named([(Cell::new(0, level, 0), material.as_str())]);
            let one = task.reading.read(one, Profile::Published);
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

    /// Returns whether a good build earns more than a log that does nothing.
    #[must_use]
    pub fn can_be_beaten(&self) -> bool {
        self.single < 1.0 && self.empty.iter().flatten().any(|empty| *empty < 1.0)
    }

    /// Computes the shaped reward of scores on the same task, in [0, 1].
    ///
    /// A check on which an empty log scores *e* < 1 gains max(0, (*s* - *e*) / (1 - *e*)) for its score *s*. Gains are
    /// averaged per criterion, and then over the criteria that have such checks. This mean, times the mean score of all
    /// other checks, which an empty log passes, is what the log earns. If a single block earns at most *b*, the reward
    /// is max(0, (earned - *b*) / (1 - *b*)), or 0 if at most one block stands after every turn. The reward never falls
    /// when the score of a check rises, and is 1 if all scores are 1.
    #[must_use]
    pub fn shaped(&self, scores: &Scores) -> f64 {
        if scores.turns.iter().all(|turn| turn.blocks <= 1) {
            return 0.0;
        }
        let scored = scores.turns.iter().zip(&self.empty).flat_map(|(turn, empty)| {
            turn.checks.iter().zip(empty).map(|(check, empty)| (check.criterion, check.score, *empty))
        });
        ((earned(scored) - self.single) / (1.0 - self.single)).max(0.0)
    }
}

/// Computes what scores earn beyond those of the empty structure, as [`Baseline::shaped`] explains.
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

/// Returns the scores of a structure that stands after every turn. Takes those of simulations from `known` if given.
fn scores(
    task: &Task,
    structure: &Structure,
    known: Option<&Vec<Vec<f64>>>,
    control: &Control<'_>,
) -> Result<Vec<Vec<f64>>, Stopped> {
    let subject = Subject::new(structure, control).for_scores();
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

/// Adds the materials and the levels that arguments contain and that are not listed yet.
fn name_all(args: &Value, materials: &mut Vec<String>, levels: &mut Vec<i32>) {
    match args {
        Value::String(name) if materials.len() <= MAX_NAMED => {
            let example = BlockSet::try_from(name.clone()).map(BlockSet::example);
            let material = example.unwrap_or(name);
            if !materials.iter().any(|known| known == material) {
                materials.push(material.to_owned());
            }
        }
        Value::Number(number) if levels.len() < LEVELS.len() + MAX_NAMED => {
            let level = number.as_i64().and_then(|level| i32::try_from(level).ok());
            levels.extend(level.filter(|level| (-2_000..=2_000).contains(level) && !levels.contains(level)));
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
    use crate::grading::{grade_log, score_log};
    use crate::tasks::embedded;
    use crate::voxel::BlockLog;
    use std::collections::BTreeMap;

    /// Returns one task of every public family; `tests/hidden_checks.rs` covers the hidden families.
    fn one_of_each_family() -> Vec<Task> {
        let mut tasks: BTreeMap<String, Task> = BTreeMap::new();
        for task in embedded::latest().unwrap().tasks {
            tasks.entry(task.family().to_owned()).or_insert(task);
        }
        // Stress simulations take long and have tests of their own.
        for task in tasks.values_mut() {
            for turn in &mut task.turns {
                turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
            }
        }
        tasks.into_values().collect()
    }

    fn shaped(task: &Task, log: &BlockLog) -> (f64, Scores) {
        let scores = score_log(task, log, &Control::unhurried()).unwrap();
        let report = grade_log(task, log, &Control::unhurried()).unwrap();
        assert_eq!(scores, Scores::from(&report), "{}: scores depend on whether evidence is asked for", task.id);
        (Baseline::of(task, &Control::unhurried()).unwrap().shaped(&scores), scores)
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
            // A spoiled build earns something in between, and every baseline can be beaten.
            assert!(Baseline::of(task, &Control::unhurried()).unwrap().can_be_beaten(), "{}", task.id);
            for saboteur in SABOTEURS {
                let (reward, scores) = shaped(task, &saboteur.spoil(good.clone()));
                let is_whole = scores.turns.iter().flat_map(|turn| &turn.checks).all(|check| check.score >= 1.0);
                assert!((0.0..=1.0).contains(&reward) && (reward >= 1.0) == is_whole, "{}: {reward}", task.id);
            }
        }
    }

    #[test]
    fn a_score_that_rises_never_lowers_the_reward() {
        for task in one_of_each_family() {
            let baseline = Baseline::of(&task, &Control::unhurried()).unwrap();
            let (_, mut scores) = shaped(&task, &build(&task).unwrap());
            for turn in 0..scores.turns.len() {
                for check in 0..scores.turns[turn].checks.len() {
                    let mut before = -1.0;
                    for tenths in 0..=10 {
                        scores.turns[turn].checks[check].score = f64::from(tenths) / 10.0;
                        let reward = baseline.shaped(&scores);
                        assert!(reward >= before, "{}", task.id);
                        before = reward;
                    }
                    // Leaves this check half earned while the next one varies.
                    scores.turns[turn].checks[check].score = 0.5;
                }
            }
        }
    }

    #[test]
    fn levels_beyond_every_build_are_not_tried() {
        let (mut materials, mut levels) = (Vec::new(), Vec::new());
        name_all(&serde_json::json!([i32::MIN, i32::MAX, i64::MIN, -2_001, -2_000, 7]), &mut materials, &mut levels);
        assert_eq!(levels, [-2_000, 7]);
    }

    #[test]
    fn a_name_that_many_checks_repeat_leaves_room_for_others() {
        let check = |of: &str, level: i32| {
            let args = serde_json::json!({ "of": of, "y": level });
            serde_json::json!({ "fn": "material.is_made_of", "args": args })
        };
        let (mut materials, mut levels) = (vec!["stone".to_owned()], LEVELS.to_vec());
        for _ in 0..=MAX_NAMED {
            name_all(&check("bricks", 4)["args"], &mut materials, &mut levels);
        }
        name_all(&check("glass", 7)["args"], &mut materials, &mut levels);
        assert_eq!(materials, ["stone", "bricks", "glass"]);
        assert_eq!(levels, [-1, 0, 1, 4, 7]);
    }
}
