//! Grading: the checks of a task on the structures of a log, and what follows for criteria and problem
//! (`docs/rules.md#scores`).

use std::borrow::Cow;

use super::advisories::{advise, advise_on_removals};
use super::report::{CheckReport, CriterionReport, Report, TurnReport};
use super::scores::{ScoredCheck, Scores, TurnScores};
use crate::checks::evidence::holds;
use crate::checks::{CHECKS_VERSION, Check, Criterion, Dimension, Finding, Subject};
use crate::elasticity::{Control, Stopped};
use crate::tasks::Task;
use crate::voxel::replay::Replay;
use crate::voxel::{BlockLog, Profile, Structure};

/// Grades a log against a task, turn by turn.
///
/// A turn that the log lacks keeps the structure of the turn before, like a turn without events
/// (`docs/rules.md#replay`).
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_log(task: &Task, log: &BlockLog, control: &Control<'_>) -> Result<Report, Stopped> {
    grade_hashed(task, &task.content_hash(), log, control)
}

/// Grades a log as [`grade_log`] does, given the task's hash, which takes as long to compute as grading a small log.
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_hashed(task: &Task, hash: &str, log: &BlockLog, control: &Control<'_>) -> Result<Report, Stopped> {
    let structures = Replay::read_as(log, task.reading);
    let mut report = grade(task, hash.to_owned(), structures, control)?;
    advise_on_removals(log, &mut report.advisories);
    Ok(Report { profile: log.profile, ..report })
}

/// Grades a log against a task as [`grade_log`] does, and keeps only the scores: checks gather no evidence, and those that
/// do not count are left out.
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn score_log(task: &Task, log: &BlockLog, control: &Control<'_>) -> Result<Scores, Stopped> {
    let mut structures = Replay::read_as(log, task.reading);
    let mut standing = Structure::from_named([]);
    let mut turns = Vec::with_capacity(task.turns.len());
    for instruction in &task.turns {
        standing = structures.next().unwrap_or(standing);
        let subject = Subject::new(&standing, control).for_scores();
        let mut checks = Vec::with_capacity(instruction.checks.len());
        for check in &instruction.checks {
            let score = evaluate(check, &subject)?.score;
            checks.push(ScoredCheck { name: Cow::Borrowed(check.name()), criterion: check.criterion(), score });
        }
        turns.push(TurnScores { blocks: blocks(&standing), checks });
    }
    let scored = turns.iter().flat_map(|turn| &turn.checks).map(|check| (check.criterion, check.score));
    let criteria = criterion_reports(&scored);
    let Verdicts { overall, accuracy } = verdicts(&criteria);
    Ok(Scores { overall, accuracy, criteria, turns })
}

/// Grades structures, one per turn, against a task. They are read as those of a log of the profile `published`.
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_structures(
    task: &Task,
    structures: impl IntoIterator<Item = Structure>,
    control: &Control<'_>,
) -> Result<Report, Stopped> {
    let structures = structures.into_iter().map(|structure| task.reading.read(structure, Profile::Published));
    grade(task, task.content_hash(), structures, control)
}

fn grade(
    task: &Task,
    task_hash: String,
    structures: impl IntoIterator<Item = Structure>,
    control: &Control<'_>,
) -> Result<Report, Stopped> {
    let mut structures = structures.into_iter();
    let mut standing = Structure::from_named([]);
    let mut turns = Vec::with_capacity(task.turns.len());
    let mut advisories = Vec::new();
    for (turn, instruction) in (1u32..).zip(&task.turns) {
        standing = structures.next().unwrap_or(standing);
        let subject = Subject::new(&standing, control);
        let checks = check_reports(&instruction.checks, &subject)?;
        let informational = check_reports(&instruction.informational, &subject)?;
        let report = TurnReport { turn, blocks: blocks(&standing), checks, informational };
        advise(&standing, instruction, &report, &mut advisories);
        turns.push(report);
    }
    let scored = turns.iter().flat_map(|turn| &turn.checks).map(|check| (check.criterion, check.finding.score));
    let criteria = criterion_reports(&scored);
    let Verdicts { overall, accuracy } = verdicts(&criteria);
    Ok(Report {
        task: task.id.clone(),
        number: task.number,
        task_hash,
        checks_version: CHECKS_VERSION,
        profile: Profile::Published,
        overall,
        accuracy,
        criteria,
        turns,
        advisories,
    })
}

/// Counts the blocks of a structure; an object in two cells, such as a door, counts once.
fn blocks(structure: &Structure) -> u64 {
    structure.cells().iter().filter(|cell| structure.other_half(**cell).is_none()).count() as u64
}

fn evaluate(check: &Check, subject: &Subject<'_>) -> Result<Finding, Stopped> {
    if (subject.control.stop)() {
        return Err(Stopped);
    }
    check.evaluate(subject)
}

fn check_reports(checks: &[Check], subject: &Subject<'_>) -> Result<Vec<CheckReport>, Stopped> {
    let mut reports = Vec::with_capacity(checks.len());
    for check in checks {
        let finding = evaluate(check, subject)?.bounded();
        let name = Cow::Borrowed(check.name());
        reports.push(CheckReport { name, args: check.args(), criterion: check.criterion(), finding });
    }
    Ok(reports)
}

/// Sums up the scores of checks, each with its criterion.
fn criterion_reports(scored: &(impl Iterator<Item = (Criterion, f64)> + Clone)) -> Vec<CriterionReport> {
    let mut reports = Vec::new();
    for criterion in Criterion::ALL {
        let scores = || scored.clone().filter(|(of, _)| *of == criterion).map(|(_, score)| score);
        let count = scores().count();
        if count == 0 {
            continue;
        }
        let at_1 = scores().filter(|score| holds(*score)).count();
        reports.push(CriterionReport {
            criterion,
            dimension: criterion.dimension(),
            holds: at_1 == count,
            mean: scores().sum::<f64>() / count as f64,
            checks: u32::try_from(count).unwrap_or(u32::MAX),
            checks_at_1: u32::try_from(at_1).unwrap_or(u32::MAX),
        });
    }
    reports
}

/// What the criteria mean for the problem as a whole.
struct Verdicts {
    overall: bool,
    accuracy: Option<bool>,
}

fn verdicts(criteria: &[CriterionReport]) -> Verdicts {
    let holds = |wanted: &dyn Fn(&CriterionReport) -> bool| {
        let mut applicable = criteria.iter().filter(|c| wanted(c)).peekable();
        applicable.peek().is_some().then(|| applicable.all(|c| c.holds))
    };
    let accuracy = holds(&|c| c.dimension == Dimension::Accuracy);
    // A problem without a criterion that decides has nothing to fail.
    let overall = holds(&|c| c.criterion.decides()).unwrap_or(true);
    Verdicts { overall, accuracy }
}
