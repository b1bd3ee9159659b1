//! Synchronous grading of one log.

use std::sync::Arc;

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderName, HeaderValue};
use axum::response::{IntoResponse as _, Response};

use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::rewards::grade::ReadRequest;
use crate::app::rewards::request::NewGrade;
use crate::app::rewards::score::GradeBody;
use crate::app::submissions::posted::Format;
use crate::http::extract::body::JsonBody;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::tasks::catalogue::Catalogue;

/// Header that says whether the result came from the cache.
pub const CACHE_HEADER: HeaderName = HeaderName::from_static("x-plumbline-cache");

/// Size in bytes up to which a body is parsed by the task that serves it; larger ones are parsed on a blocking thread.
const QUICK_BYTES: usize = 128 << 10;

/// Size in bytes of a response without a report: a few hundred for a task with few checks.
const TYPICAL_BYTES: usize = 2 << 10;

/// Grades a log synchronously.
///
/// The response has the scores and a reward. Nothing is stored, and nothing appears on a board. A failure of the
/// service is a problem whose `reward` is null, never a score; `retryable` says whether the same request may succeed
/// later.
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
    let read = |catalogue: Arc<Catalogue>| {
        let bytes = bytes.clone();
        async move {
            if bytes.len() <= QUICK_BYTES {
                return ReadRequest::read(&bytes, &catalogue);
            }
            let reading = tokio::task::spawn_blocking(move || ReadRequest::read(&bytes, &catalogue));
            reading.await.map_err(|error| AppError::internal(&error))?
        }
    };
    let request = state.with_catalogue(read).await?;
    let prepared = request.prepare(&state, who).await.map_err(AppError::without_reward_where_ours)?;
    let (graded, is_cached) = prepared.grade(&state, who).await?;
    let outcome = HeaderValue::from_static(if is_cached { "hit" } else { "miss" });
    // Grown from nothing, the text would be copied several times.
    let mut text = Vec::with_capacity(TYPICAL_BYTES);
    serde_json::to_writer(&mut text, &graded).map_err(|error| AppError::internal(&error).without_reward())?;
    let headers = [(CACHE_HEADER, outcome), (CONTENT_TYPE, HeaderValue::from_static("application/json"))];
    Ok((headers, text).into_response())
}
