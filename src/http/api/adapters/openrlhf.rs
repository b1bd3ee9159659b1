//! OpenRLHF's remote reward model: `query`, `prompts` and `labels` in, `rewards`, `scores` and `extra_logs` out.
//!
//! `query` holds prompt and answer in one text each. A label names the task: its id, its number, or JSON with `task`, `suite`
//! and `reward`.

use axum::Json;
use axum::extract::State;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::super::super::body::JsonBody;
use super::super::super::caller::Caller;
use super::super::super::limits::LIMITS;
use super::super::super::problem::{ApiError, ApiResult, Problem};
use super::super::super::state::AppState;
use super::{Judged, judge};
use crate::store::keys::Scope;
use crate::voxel::Faults;

/// What OpenRLHF posts.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(example = json!({ "query": ["Raise a wall.{\"events\": []}"], "prompts": ["Raise a wall."], "labels": ["walls/5x1x5-raise"] }))]
pub struct RewardQuery {
    /// Prompt and answer of each sample.
    pub query: Vec<String>,
    /// The prompt of each sample, which is taken off the query where it begins with it.
    #[serde(default)]
    pub prompts: Vec<String>,
    /// The task of each sample: its id, its number, or JSON with `task`, `suite` and `reward`.
    #[schema(value_type = Vec<String>)]
    pub labels: Vec<Value>,
}

/// What OpenRLHF reads.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Rewards {
    /// The reward of each sample.
    pub rewards: Vec<f64>,
    /// 1 where the sample passes, else 0; for filtering.
    pub scores: Vec<f64>,
    /// Figures to log, a value per sample.
    pub extra_logs: ExtraLogs,
}

/// Figures of samples.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
pub struct ExtraLogs {
    /// 1 where the problem passes.
    pub overall: Vec<f64>,
    /// Mean over the criteria that apply; 0 where there is no log.
    pub criteria_mean: Vec<f64>,
    /// 1 where the answer held a log that fits the task.
    pub readable: Vec<f64>,
}

/// Grade what a model answered, as OpenRLHF asks a remote reward model. An answer without a log that fits the task has reward
/// 0. Where grading one of them fails through us, the whole request fails with a retryable problem, never a reward.
#[utoipa::path(
    post, path = "/get_reward", operation_id = "get_reward", tag = "rewards", summary = "OpenRLHF: rewards of samples",
    request_body(content = RewardQuery, content_type = "application/json"),
    responses(
        (status = 200, description = "Rewards in the order of the samples", body = Rewards,
         example = json!({ "rewards": [1.0], "scores": [1.0],
                           "extra_logs": { "overall": [1.0], "criteria_mean": [1.0], "readable": [1.0] } })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not JSON by its type", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A label that names no task, or lists of different lengths", body = Problem,
         content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
        (status = 504, description = "A deadline passed", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_reward(State(state): State<AppState>, caller: Caller, body: JsonBody) -> ApiResult<Json<Rewards>> {
    caller.require(Scope::Grade)?;
    let place = state.grader.admit_batch().map_err(ApiError::without_reward)?;
    let catalogue = state.store.current_catalogue().await?;
    let work = tokio::task::spawn_blocking(move || {
        let _place = place;
        let query = read(&body.bytes)?;
        let judge_one = |i: usize| {
            let prompt = query.prompts.get(i).map_or("", String::as_str);
            let answer = query.query[i].strip_prefix(prompt).unwrap_or(&query.query[i]);
            judge(&state, &catalogue, &naming(&query.labels[i]), answer)
                .map_err(|error| error.at(&format!("/labels/{i}")))
        };
        let judged: Vec<Judged> = (0..query.query.len()).into_par_iter().map(judge_one).collect::<ApiResult<_>>()?;
        Ok(Json(rewards(&judged)))
    });
    work.await.map_err(|error| ApiError::internal(&error))?
}

fn read(text: &[u8]) -> ApiResult<RewardQuery> {
    let mut faults = Faults::new();
    let query: RewardQuery = serde_json::from_slice(text).map_err(|error| {
        let mut faults = Faults::new();
        faults.add(error.to_string());
        if error.is_data() { ApiError::faulty(faults) } else { ApiError::malformed(faults) }
    })?;
    let samples = query.query.len();
    if query.labels.len() != samples {
        faults.add_at("labels", format!("{} labels for {samples} samples", query.labels.len()));
    }
    if !query.prompts.is_empty() && query.prompts.len() != samples {
        faults.add_at("prompts", format!("{} prompts for {samples} samples", query.prompts.len()));
    }
    if samples > LIMITS.grade_batch_logs {
        faults.add_at("query", format!("{samples} samples; at most {} are allowed", LIMITS.grade_batch_logs));
    }
    if faults.is_empty() { Ok(query) } else { Err(ApiError::faulty(faults)) }
}

/// A label as JSON, or as the bare name of a task.
fn naming(label: &Value) -> Value {
    if label.is_object() {
        return label.clone();
    }
    let Some(text) = label.as_str() else { return json!({ "task": label }) };
    match serde_json::from_str::<Value>(text) {
        Ok(Value::Object(naming)) => Value::Object(naming),
        Ok(number @ Value::Number(_)) => json!({ "task": number }),
        _ => json!({ "task": text }),
    }
}

fn rewards(judged: &[Judged]) -> Rewards {
    let mut rewards = Rewards { rewards: Vec::new(), scores: Vec::new(), extra_logs: ExtraLogs::default() };
    for one in judged {
        let (overall, mean, readable) = match one {
            Judged::Graded(graded) => {
                let means = graded.criteria.iter().map(|criterion| criterion.mean);
                (f64::from(graded.overall), means.sum::<f64>() / graded.criteria.len().max(1) as f64, 1.0)
            }
            Judged::Unreadable(_) => (0.0, 0.0, 0.0),
        };
        rewards.rewards.push(one.reward());
        rewards.scores.push(overall);
        rewards.extra_logs.overall.push(overall);
        rewards.extra_logs.criteria_mean.push(mean);
        rewards.extra_logs.readable.push(readable);
    }
    rewards
}
