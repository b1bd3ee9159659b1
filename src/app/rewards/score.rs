//! Result of grading within a request: a reward and its components.

use std::borrow::Cow;
use std::sync::Arc;

use serde::Serialize;

use super::model_text::AnswerBody;
use crate::actions::turn_replay::TurnReplay;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::Report;
use plumbline_engine::grading::report::CriterionReport;
use plumbline_engine::grading::reward::RewardComponents;

/// Score of one check.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct CheckScore {
    /// Number of the turn, from 1.
    pub turn: u32,
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schema(value_type = String)]
    pub name: Cow<'static, str>,
    /// Criterion that the check counts for.
    pub criterion: Criterion,
    /// Score in [0, 1].
    #[schema(minimum = 0, maximum = 1)]
    pub score: f64,
}

/// Check that cannot be measured from what was sent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct UnmeasuredCheck {
    /// Number of the turn, from 1.
    pub turn: u32,
    /// Name of the check.
    #[serde(rename = "fn")]
    pub name: String,
    /// Criterion that the check counts for.
    pub criterion: Criterion,
    /// Why it cannot be measured.
    #[schema(value_type = String)]
    pub why: &'static str,
}

/// Time taken, in microseconds. Everything else in a response depends only on the log, the task and the checks.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct Timings {
    /// Time to read the request.
    pub read_us: u64,
    /// Time to grade, or to find the cached result.
    pub grade_us: u64,
}

/// Result of grading a log.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct GradeBody {
    /// Identifier of the task.
    pub task: String,
    /// SHA-256 of the task, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub task_hash: String,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Version of the checks that scored the log.
    pub checks_version: u32,
    /// Reward, in [0, 1].
    #[schema(minimum = 0, maximum = 1)]
    pub reward: f64,
    /// Name of the scheme that computed the reward.
    #[schema(value_type = SchemeUsed, example = "strict")]
    pub scheme: &'static str,
    /// Whether the log passes the whole task.
    pub overall: bool,
    /// Whether the log passes on accuracy, if accuracy applies to the task.
    pub accuracy: Option<bool>,
    /// Components from which rewards are computed.
    pub components: RewardComponents,
    /// Criteria that apply to the task.
    pub criteria: Vec<CriterionReport>,
    /// Score of each check.
    pub checks: Vec<CheckScore>,
    /// Checks left out because they cannot be measured; the task's hash is that of the task without them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub not_measured: Vec<UnmeasuredCheck>,
    /// The whole report, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Report>)]
    pub report: Option<Arc<Report>>,
    /// Results of the action code of its turns, if there was any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
    /// Answers found in the texts of the model, if the request has `answer`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub answer: Option<AnswerBody>,
    /// Time taken.
    pub timings: Timings,
}

/// Scheme that computed a reward.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SchemeUsed {
    /// 1 if the task passes overall, otherwise 0.
    Strict,
    /// Score earned beyond that of a log that does nothing.
    Shaped,
    /// Mean over the criteria that apply.
    Mean,
    /// Weighted mean over the criteria that apply and have a weight.
    Weighted,
}
