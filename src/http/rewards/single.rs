//! Grading within the request: one log, or many whose results stream back.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderName, HeaderValue};
use axum::response::{IntoResponse as _, Response};
use serde_json::Value;

use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::rewards::grade::ReadRequest;
use crate::app::rewards::request::Detail;
use crate::app::rewards::score::GradeBody;
use crate::app::submissions::posted::Format;
use crate::http::extract::body::JsonBody;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::http::submissions::schema::{NewTurn, StoredLogBody};
use crate::store::keys::Scope;
use plumbline_engine::checks::Criterion;

/// A log to grade at once.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "task": "walls/5x1x5-raise", "reward": "mean",
    "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
}))]
#[expect(dead_code, reason = "describes the body that GradeShape reads")]
pub struct NewGrade {
    /// The task: its id, its number, or a whole task: an object with `turns`, each with `checks` of `fn` and `args`.
    #[schema(value_type = GivenTaskBody)]
    task: Value,
    /// Suite of the task, where it is named: name, or name@version.
    #[schema(min_length = 1, max_length = 100)]
    suite: Option<String>,
    /// What was done in each turn; as many as the task has. One of this, `log` and `answer` is needed.
    #[schema(max_items = 64)]
    turns: Option<Vec<NewTurn>>,
    /// The same in the stored form, as `/v1/submissions/{id}/log` shows it.
    log: Option<StoredLogBody>,
    /// What a language model wrote, a text or a list of them: the last complete answer outside thinking tags counts, a log as JSON
    /// or action code, in a code fence or bare. Of several texts each answers a turn.
    #[schema(value_type = Option<AnswerTextsBody>)]
    answer: Option<Value>,
    /// How the reward is made; `strict` where nothing is said.
    #[schema(value_type = Option<SchemeBody>)]
    reward: Option<Value>,
    /// How much is answered; `scores` where nothing is said.
    detail: Option<Detail>,
    /// Milliseconds that grading may take; default and maximum are in `/v1/limits`.
    #[schema(minimum = 1, maximum = 50_000)]
    deadline_ms: Option<u64>,
}

/// A task that is named, or brought along.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum GivenTaskBody {
    /// Its id.
    Id(String),
    /// Its number in the suite.
    Number(u32),
    /// A whole task.
    Whole(InlineTask),
}

/// A task that a request brings, as `GET /v1/tasks/{family}/{instance}` shows one; what else it says is not needed.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineTask {
    /// What it is called in the answer.
    pub id: Option<String>,
    /// Its turns.
    #[schema(min_items = 1, max_items = 64)]
    pub turns: Vec<InlineTurn>,
}

/// A turn of such a task.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineTurn {
    /// The instruction, for the record.
    pub prompt: Option<String>,
    /// What is checked after it.
    #[schema(max_items = 64)]
    pub checks: Vec<InlineCheck>,
}

/// A check of such a task.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineCheck {
    /// Its name.
    #[serde(rename = "fn")]
    #[schema(example = "shape.has_rooms")]
    pub name: String,
    /// Its arguments.
    #[schema(value_type = Option<Object>, example = json!({ "room_cnt": 2 }))]
    pub args: Option<serde_json::Map<String, Value>>,
}

/// How a reward is made of a report.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SchemeBody {
    /// By a scheme of this name.
    Named(SchemeName),
    /// By weights: the weighted mean over the criteria that apply.
    Weighted(WeightsBody),
}

/// A scheme.
#[derive(Debug, Clone, Copy, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SchemeName {
    /// 1 where the problem passes, else 0.
    Strict,
    /// What is earned beyond a log that does nothing: 0 for an empty log or a single block, 1 where all checks pass. For training.
    Shaped,
    /// The mean of the criteria that apply. An empty log earns 0.44 of it on average over Lite, so a model may learn to do nothing.
    Mean,
}

/// Weights of criteria.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct WeightsBody {
    /// 0 or more for each; those that are not named have 0.
    #[schema(example = json!({ "material": 1, "shape": 2 }))]
    pub weights: std::collections::BTreeMap<Criterion, f64>,
}

/// What a model wrote.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum AnswerTextsBody {
    /// One text.
    One(String),
    /// Several, in order.
    Several(Vec<String>),
}

/// Header that tells whether a result was computed or kept from before.
pub const CACHE_HEADER: HeaderName = HeaderName::from_static("x-plumbline-cache");

/// Bodies up to this size are read where they arrive; larger ones on a thread of their own.
const QUICK_BYTES: usize = 128 << 10;

/// Grade a log at once: the answer has the scores and a reward. Nothing is stored and nothing comes onto a board. A failure
/// of ours is a problem whose `reward` is null, never a score; `retryable` says that the same request may succeed later.
#[utoipa::path(
    post, path = "/v1/grade", operation_id = "grade", tag = "rewards", summary = "Grade a log at once",
    request_body(content = NewGrade, content_type = "application/json"),
    responses(
        (status = 200, description = "Scores and reward", body = GradeBody,
         headers(("x-plumbline-cache" = String, description = "`hit` where the result was kept from before, else `miss`")),
         example = json!({ "task": "walls/5x1x5-raise", "reward": 1.0, "scheme": "strict", "overall": true, "accuracy": true,
                           "criteria": [], "checks": [], "timings": { "read_us": 20, "grade_us": 30 } })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not JSON by its type", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy or stopping; come back", body = Problem, content_type = "application/problem+json"),
        (status = 504, description = "The deadline passed", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn grade(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Response> {
    caller.require(Scope::Grade)?;
    let JsonBody { bytes, format, share: _share } = body;
    if format == Format::NdJson {
        return Err(AppError::not_ndjson("many logs go to /v1/grade:batch"));
    }
    let who = caller.who();
    let _place = state.grader.admit(who).map_err(AppError::without_reward)?;
    let catalogue = state.store.catalogue();
    let request = if bytes.len() <= QUICK_BYTES {
        ReadRequest::read(&bytes, &catalogue)?
    } else {
        let reading = tokio::task::spawn_blocking(move || ReadRequest::read(&bytes, &catalogue));
        reading.await.map_err(|error| AppError::internal(&error))??
    };
    let prepared = request.prepare(&state, who).await.map_err(AppError::without_reward_where_ours)?;
    let (graded, is_cached) = prepared.grade(&state, who).await?;
    let outcome = HeaderValue::from_static(if is_cached { "hit" } else { "miss" });
    Ok(([(CACHE_HEADER, outcome)], Json(graded)).into_response())
}
