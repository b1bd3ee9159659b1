//! The report on one submission, by turn, check and criterion, and for the problem as a whole (`docs/rules.md#scores`).

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::advisory::Advisory;
use super::summary::ProblemScores;
use crate::checks::evidence::value_bytes;
use crate::checks::{Criterion, Dimension, Finding};
use crate::voxel::Profile;

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CheckReport {
    /// Name of the check, such as `size.is_equal`.
    #[serde(rename = "fn")]
    #[schema(value_type = String)]
    pub name: Cow<'static, str>,
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
    /// Rules under which the log became a build; absent for `published`.
    #[serde(default, skip_serializing_if = "Profile::is_published")]
    pub profile: Profile,
    /// Whether accuracy, physical plausibility and dependency all pass, as far as they apply (`docs/rules.md#scores`).
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
            let own = |check: &CheckReport| value_bytes(&check.args) + check.finding.heap_bytes();
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
