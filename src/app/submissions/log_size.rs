//! The size of a log: as many turns as its task has, and no more blocks than a grade can take.

use crate::app::limits::LIMITS;
use plumbline_engine::checks::Criterion;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::Task;
use plumbline_engine::text::{agreeing, counted};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Event};

/// Returns the greatest number of blocks that may stand after a turn of a task.
#[must_use]
pub fn most_blocks(task: &Task) -> usize {
    let has_stress = task.checks().any(|check| check.criterion() == Criterion::StructuralStability);
    if has_stress { LIMITS.blocks_with_stress } else { LIMITS.blocks }
}

/// The same for what a model wrote where a request waits for the grade: no model may make it run out of time, which would
/// be no reward instead of a low one.
#[must_use]
pub fn most_blocks_of_model(task: &Task) -> usize {
    let most = most_blocks(task);
    if most == LIMITS.blocks_with_stress { LIMITS.grade_blocks_with_stress } else { most }
}

/// Adds the faults of a log that depend on its task: the number of turns, and the number of blocks, of which at most
/// `most` may stand.
pub fn check_against_task(log: &BlockLog, task: &Task, most: usize, faults: &mut Faults) {
    let (found, wanted) = (log.turns.len(), task.turns.len());
    if found != wanted {
        let found = counted(found, "turn");
        let detail = format!("{found}; the task has {wanted} (a turn in which nothing was done is {{\"events\": []}})");
        faults.add_at("turns", detail);
    } else if let Some(stand) = more_than(most, log) {
        let kind = if most < LIMITS.blocks { " of a task with a stress simulation" } else { "" };
        faults.add_at("turns", format!("{stand} after a turn{kind}; at most {most} are allowed"));
    }
}

/// The same for the answer to a hidden instance. They depend only on the log and the number of prompts, so they reveal
/// nothing about the checks.
pub fn check_against_prompts(log: &BlockLog, prompts: usize, faults: &mut Faults) {
    let most = LIMITS.blocks_with_stress;
    let found = log.turns.len();
    if found != prompts {
        let found = counted(found, "turn");
        faults.add_at("turns", format!("found {found}; expected {prompts}, one for each prompt"));
    } else if let Some(stand) = more_than(most, log) {
        faults.add_at("turns", format!("{stand} after a turn; at most {most} are allowed"));
    }
}

/// Returns, in words, how many blocks stand after the first turn that leaves more than `most`; none if no turn does.
fn more_than(most: usize, log: &BlockLog) -> Option<String> {
    let placed = log.turns.iter().flatten().filter(|event| matches!(event, Event::Place { .. })).count();
    // Replaying is expensive; a log with few placements cannot exceed the limit.
    if placed <= most {
        return None;
    }
    let blocks = Replay::new(log).map(|structure| structure.len()).find(|blocks| *blocks > most)?;
    Some(agreeing(blocks, "block stands", "blocks stand"))
}
