//! Synchronous grading of one log.

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
use crate::http::state::AppState;
use crate::http::submissions::schema::{NewTurn, StoredLogBody};
use crate::store::keys::Scope;
use plumbline_engine::checks::Criterion;

/// A log to grade synchronously.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "task": "walls/5x1x5-raise", "reward": "mean",
    "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
}))]
#[expect(dead_code, reason = "describes the body that GradeShape reads")]
pub struct NewGrade {
    /// The task: its id, its number, or a whole task, which is an object with `turns`, each with `checks` of `fn` and
    /// `args`.
    #[schema(value_type = GivenTaskBody)]
    task: Value,
    /// Suite of the task, if it is given by id or number: name, or name@version.
    #[schema(min_length = 1, max_length = 100)]
    suite: Option<String>,
    /// Turns of the log, as many as the task has. One of `turns`, `log` and `answer` is required.
    #[schema(max_items = 64)]
    turns: Option<Vec<NewTurn>>,
    /// The log in the stored form, as `/v1/submissions/{id}/log` returns it.
    log: Option<StoredLogBody>,
    /// Text or list of texts from a language model. The last complete answer outside thinking tags counts: a log as
    /// JSON, or action code, in a code fence or bare. If there are several texts, each answers a turn.
    #[schema(value_type = Option<AnswerTextsBody>)]
    answer: Option<Value>,
    /// Reward scheme; `strict` by default.
    #[schema(value_type = Option<SchemeBody>)]
    reward: Option<Value>,
    /// Level of detail of the response; `scores` by default.
    detail: Option<Detail>,
    /// Deadline for grading, in milliseconds; `/v1/limits` has the default and the maximum.
    #[schema(minimum = 1, maximum = 50_000)]
    deadline_ms: Option<u64>,
}

/// A task, either of a suite or inline.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum GivenTaskBody {
    /// Identifier of the task.
    Id(String),
    /// Number of the task in the suite.
    Number(u32),
    /// An inline task.
    Whole(InlineTask),
}

/// An inline task, as `GET /v1/tasks/{family}/{instance}` returns it; other members of the task are ignored.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineTask {
    /// Identifier of the task in the response.
    pub id: Option<String>,
    /// Turns of the task.
    #[schema(min_items = 1, max_items = 64)]
    pub turns: Vec<InlineTurn>,
}

/// A turn of an inline task.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineTurn {
    /// Instruction to the agent, for the record.
    pub prompt: Option<String>,
    /// Checks of the structure after the turn.
    #[schema(max_items = 64)]
    pub checks: Vec<InlineCheck>,
}

/// A check of an inline task.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct InlineCheck {
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schema(example = "shape.has_rooms")]
    pub name: String,
    /// Arguments of the check.
    #[schema(value_type = Option<Object>, example = json!({ "room_cnt": 2 }))]
    pub args: Option<serde_json::Map<String, Value>>,
}

/// Scheme that turns a report into a reward.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SchemeBody {
    /// A scheme, by its name.
    Named(SchemeName),
    /// Weights, for the weighted mean over the criteria that apply.
    Weighted(WeightsBody),
}

/// Name of a reward scheme.
#[derive(Debug, Clone, Copy, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SchemeName {
    /// 1 if the problem passes, else 0.
    Strict,
    /// Gain over a log that does nothing, for training: 0 for an empty log or a single block, 1 if all checks pass.
    Shaped,
    /// Mean of the criteria that apply. An empty log earns 0.44 on average over Lite, so a model may learn to do
    /// nothing.
    Mean,
}

/// Weights of criteria.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
pub struct WeightsBody {
    /// Weight of each criterion, 0 or more; criteria that are not listed have 0.
    #[schema(example = json!({ "material": 1, "shape": 2 }))]
    pub weights: std::collections::BTreeMap<Criterion, f64>,
}

/// Text that a model wrote.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum AnswerTextsBody {
    /// One text.
    One(String),
    /// Several texts, in order.
    Several(Vec<String>),
}

/// Header that says whether the result came from the cache.
pub const CACHE_HEADER: HeaderName = HeaderName::from_static("x-plumbline-cache");

/// Size in bytes up to which a body is parsed by the task that serves it; larger ones are parsed on a blocking thread.
const QUICK_BYTES: usize = 128 << 10;

/// Grades a log synchronously; the response has the scores and a reward. Nothing is stored, and nothing appears on a
/// board. A failure of the service is a problem whose `reward` is null, never a score; `retryable` says whether the
/// same request may succeed later.
#[utoipa::path(
    post, path = "/v1/grade", operation_id = "grade", tag = "rewards", summary = "Grade a log synchronously",
    request_body(content = NewGrade, content_type = "application/json"),
    responses(
        (status = 200, description = "Scores and reward", body = GradeBody,
         headers(("x-plumbline-cache" = String, description = "`hit` if the result came from the cache, else `miss`")),
         example = json!({ "task": "walls/5x1x5-raise", "reward": 1.0, "scheme": "strict", "overall": true, "accuracy": true,
                           "criteria": [], "checks": [], "timings": { "read_us": 20, "grade_us": 30 } })),
        (status = 504, description = "The deadline passed"),
    )
)]
pub async fn grade(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Response> {
    caller.require(Scope::Grade)?;
    let JsonBody { bytes, format, share: _share } = body;
    if format == Format::NdJson {
        return Err(AppError::not_ndjson("send many logs to /v1/grade:batch"));
    }
    let who = caller.who();
    let _permit = state.grader.admit(who).map_err(AppError::without_reward)?;
    let catalogue = state.catalogue();
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
