//! The scores of a submission without their evidence: what a reward needs. They take less time and memory than a report.

use std::borrow::Cow;

use super::report::{CriterionReport, Report};
use crate::checks::Criterion;

/// Score of one check.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredCheck {
    /// Name of the check.
    pub name: Cow<'static, str>,
    /// Criterion that the check belongs to.
    pub criterion: Criterion,
    /// Score in [0, 1].
    pub score: f64,
}

/// Scores of one turn.
#[derive(Debug, Clone, PartialEq)]
pub struct TurnScores {
    /// Number of blocks that stand after the turn.
    pub blocks: u64,
    /// Scores of the checks that count, in the task's order.
    pub checks: Vec<ScoredCheck>,
}

/// Scores of one submission.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    /// Whether the problem passes.
    pub overall: bool,
    /// Whether accuracy passes; `None` if the task has no check of it.
    pub accuracy: Option<bool>,
    /// Results of the criteria that apply, in the paper's order.
    pub criteria: Vec<CriterionReport>,
    /// Scores of the turns, in order.
    pub turns: Vec<TurnScores>,
}

impl Scores {
    /// Returns the memory that the scores take, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let checks = self.turns.iter().map(|turn| turn.checks.capacity()).sum::<usize>();
        size_of::<Self>()
            + self.criteria.capacity() * size_of::<CriterionReport>()
            + self.turns.capacity() * size_of::<TurnScores>()
            + checks * size_of::<ScoredCheck>()
    }
}

impl From<&Report> for Scores {
    fn from(report: &Report) -> Self {
        let turns = report.turns.iter().map(|turn| {
            let checks = turn.checks.iter().map(|check| ScoredCheck {
                name: check.name.clone(),
                criterion: check.criterion,
                score: check.finding.score,
            });
            TurnScores { blocks: turn.blocks, checks: checks.collect() }
        });
        Self {
            overall: report.overall,
            accuracy: report.accuracy,
            criteria: report.criteria.clone(),
            turns: turns.collect(),
        }
    }
}
