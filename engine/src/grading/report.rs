//! The report on one submission, by turn, check and criterion, and for the problem as a whole (SPEC 5).

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::advisories::{Advisory, advise};
use super::summary::ProblemScores;
use crate::checks::evidence::value_bytes;
use crate::checks::{CHECKS_VERSION, Check, Criterion, Dimension, Finding, Subject};
use crate::elasticity::{Control, Stopped};
use crate::tasks::Task;
use crate::voxel::replay::Replay;
use crate::voxel::{BlockLog, Structure};

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CheckReport {
    /// Name of the check, such as `size.is_equal`.
    #[serde(rename = "fn")]
    pub name: String,
    /// Arguments of the check, by name.
    pub args: Value,
    /// Criterion that the check belongs to.
    pub criterion: Criterion,
    /// Score and evidence.
    #[serde(flatten)]
    pub finding: Finding,
}

/// Results of one turn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TurnReport {
    /// Turn number, from 1.
    pub turn: u32,
    /// Number of blocks that stand after the turn.
    pub blocks: u64,
    /// Results of the checks that count, in the task's order.
    pub checks: Vec<CheckReport>,
    /// Results of the checks that are reported but do not count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub informational: Vec<CheckReport>,
}

/// Result of one criterion over all turns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CriterionReport {
    /// The criterion.
    pub criterion: Criterion,
    /// Dimension that the criterion belongs to.
    pub dimension: Dimension,
    /// Whether all its checks scored 1.
    pub holds: bool,
    /// Mean score of its checks.
    #[schema(minimum = 0, maximum = 1)]
    pub mean: f64,
    /// Number of its checks.
    pub checks: u32,
    /// Number of its checks that scored 1.
    pub checks_at_1: u32,
}

/// The report on one submission. It holds neither times nor hosts: the same log, task and checks yield the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Report {
    /// Identifier of the task.
    pub task: String,
    /// Number of the task in its suite.
    pub number: u32,
    /// SHA-256 hash of the task's JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub task_hash: String,
    /// Version of the checks that scored the submission.
    pub checks_version: u32,
    /// Whether accuracy, physical plausibility and dependency all pass, as far as they apply (SPEC 5).
    pub overall: bool,
    /// Whether material, shape and size all pass, as far as they apply; null if the task has no such check.
    pub accuracy: Option<bool>,
    /// Results of the criteria that apply, in the paper's order.
    pub criteria: Vec<CriterionReport>,
    /// Results of the turns, in order.
    pub turns: Vec<TurnReport>,
    /// Warnings that help to read the scores. They never change a score.
    pub advisories: Vec<Advisory>,
}

impl Report {
    /// Returns the memory that the report takes, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let checks = |list: &Vec<CheckReport>| {
            let own =
                |check: &CheckReport| check.name.capacity() + value_bytes(&check.args) + check.finding.heap_bytes();
            list.capacity() * size_of::<CheckReport>() + list.iter().map(own).sum::<usize>()
        };
        let turns = self.turns.iter().map(|turn| checks(&turn.checks) + checks(&turn.informational)).sum::<usize>();
        size_of::<Self>()
            + self.task.capacity()
            + self.task_hash.capacity()
            + self.criteria.capacity() * size_of::<CriterionReport>()
            + self.turns.capacity() * size_of::<TurnReport>()
            + self.advisories.iter().map(Advisory::heap_bytes).sum::<usize>()
            + turns
    }

    /// Returns the scores that the summary of a run needs.
    #[must_use]
    pub fn scores(&self) -> ProblemScores {
        let checks = self.turns.iter().flat_map(|turn| &turn.checks);
        ProblemScores {
            number: self.number,
            rows: checks.map(|check| (check.criterion, check.finding.score)).collect(),
        }
    }
}

/// Grades a log against a task, turn by turn.
///
/// A turn that the log lacks keeps the structure of the turn before, like a turn without events (SPEC 2).
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_log(task: &Task, log: &BlockLog, control: &Control<'_>) -> Result<Report, Stopped> {
    grade_structures(task, Replay::new(log), control)
}

/// Grades a log as [`grade_log`] does, given the task's hash, which takes as long to compute as grading a small log.
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_hashed(task: &Task, hash: &str, log: &BlockLog, control: &Control<'_>) -> Result<Report, Stopped> {
    grade(task, hash.to_owned(), Replay::new(log), control)
}

/// Grades structures, one per turn, against a task.
///
/// # Errors
/// Returns an error only if `control` stops a long computation.
pub fn grade_structures(
    task: &Task,
    structures: impl IntoIterator<Item = Structure>,
    control: &Control<'_>,
) -> Result<Report, Stopped> {
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
        let subject = Subject { structure: &standing, control };
        let checks = check_reports(&instruction.checks, &subject)?;
        let informational = check_reports(&instruction.informational, &subject)?;
        let report = TurnReport { turn, blocks: standing.len() as u64, checks, informational };
        advise(&standing, instruction, &report, &mut advisories);
        turns.push(report);
    }
    let criteria = criterion_reports(&turns);
    let holds = |wanted: &dyn Fn(&CriterionReport) -> bool| {
        let mut applicable = criteria.iter().filter(|c| wanted(c)).peekable();
        applicable.peek().is_some().then(|| applicable.all(|c| c.holds))
    };
    let accuracy = holds(&|c| c.dimension == Dimension::Accuracy);
    let plausible = holds(&|c| c.criterion == Criterion::PhysicalPlausibility);
    let ordered = holds(&|c| c.criterion == Criterion::Dependency);
    Ok(Report {
        task: task.id.clone(),
        number: task.number,
        task_hash,
        checks_version: CHECKS_VERSION,
        overall: [accuracy, plausible, ordered].into_iter().all(|part| part.unwrap_or(true)),
        accuracy,
        criteria,
        turns,
        advisories,
    })
}

fn check_reports(checks: &[Check], subject: &Subject<'_>) -> Result<Vec<CheckReport>, Stopped> {
    let mut reports = Vec::with_capacity(checks.len());
    for check in checks {
        if (subject.control.stop)() {
            return Err(Stopped);
        }
        reports.push(check_report(check, check.evaluate(subject)?.bounded()));
    }
    Ok(reports)
}

fn check_report(check: &Check, finding: Finding) -> CheckReport {
    let mut data = serde_json::to_value(check).unwrap_or_default();
    let args = data.get_mut("args").map(Value::take).unwrap_or_default();
    CheckReport { name: check.name().to_owned(), args, criterion: check.criterion(), finding }
}

fn criterion_reports(turns: &[TurnReport]) -> Vec<CriterionReport> {
    let mut reports = Vec::new();
    for criterion in Criterion::ALL {
        let checks = || turns.iter().flat_map(|t| &t.checks).filter(|c| c.criterion == criterion);
        let count = checks().count();
        if count == 0 {
            continue;
        }
        let at_1 = checks().filter(|c| c.finding.holds()).count();
        reports.push(CriterionReport {
            criterion,
            dimension: criterion.dimension(),
            holds: at_1 == count,
            mean: checks().map(|c| c.finding.score).sum::<f64>() / count as f64,
            checks: u32::try_from(count).unwrap_or(u32::MAX),
            checks_at_1: u32::try_from(at_1).unwrap_or(u32::MAX),
        });
    }
    reports
}
