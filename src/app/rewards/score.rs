//! The result of grading within a request: a reward, and what it is made of.

use std::sync::Arc;

use serde::Serialize;

use super::model_text::AnswerBody;
use crate::app::replay::TurnReplay;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::Report;
use plumbline_engine::grading::report::CriterionReport;
use plumbline_engine::grading::reward::RewardComponents;

/// The score of one check.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct CheckScore {
    /// Turn, from 1.
    pub turn: u32,
    /// Name.
    #[serde(rename = "fn")]
    pub name: String,
    /// The criterion it counts for.
    pub criterion: Criterion,
    /// In [0, 1].
    #[schema(minimum = 0, maximum = 1)]
    pub score: f64,
}

/// How long it took, in microseconds. All else in an answer depends on log, task and checks alone.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct Timings {
    /// Reading the request.
    pub read_us: u64,
    /// Grading, or finding the result that was kept.
    pub grade_us: u64,
}

/// A graded log.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct GradeBody {
    /// The task's id.
    pub task: String,
    /// SHA-256 of the task, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub task_hash: String,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Version of the rules that scored it.
    pub checks_version: u32,
    /// The reward, in [0, 1].
    #[schema(minimum = 0, maximum = 1)]
    pub reward: f64,
    /// The scheme that made it.
    #[schema(value_type = SchemeUsed, example = "strict")]
    pub scheme: &'static str,
    /// Whether the problem passes.
    pub overall: bool,
    /// Whether its accuracy passes, where it applies.
    pub accuracy: Option<bool>,
    /// What rewards are made of.
    pub components: RewardComponents,
    /// The criteria that apply.
    pub criteria: Vec<CriterionReport>,
    /// A score per check.
    pub checks: Vec<CheckScore>,
    /// The whole report, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Report>)]
    pub report: Option<Arc<Report>>,
    /// What the action code of its turns did, where it brought some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
    /// What was found in the model's texts, where the request brought `answer`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub answer: Option<AnswerBody>,
    /// How long it took.
    pub timings: Timings,
}

/// The scheme that made a reward.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SchemeUsed {
    /// As asked for.
    Strict,
    /// As asked for.
    Shaped,
    /// As asked for.
    Mean,
    /// By weights.
    Weighted,
}
