//! One submission: reading its state and its position in the queue, and cancelling it.

use axum::Json;
use axum::extract::{Path, State};

use super::schema::SubmissionBody;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::clock::now_ms;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use crate::store::states::SubmissionState;
use crate::store::submissions::SubmissionRow;

/// Returns the stored submission with this id.
///
/// # Errors
/// Returns an error (404) if there is no such submission.
pub async fn stored(state: &AppState, id: &str) -> AppResult<SubmissionRow> {
    let row = state.store.submission(id).await?;
    row.ok_or_else(|| AppError::not_found(format!("there is no submission {id:?}")))
}

/// Returns a submission's state and, once graded, its verdict.
#[utoipa::path(
    get, path = "/v1/submissions/{id}", operation_id = "get_submission", tag = "submissions", summary = "Get a submission",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The submission", body = SubmissionBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "state": "graded", "overall": true })),
    )
)]
pub async fn get_submission(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<SubmissionBody>> {
    let row = stored(&state, &id).await?;
    Ok(Json(body_of(&state, row).await?))
}

/// Builds the body of a submission, with its position in the queue while it is queued.
async fn body_of(state: &AppState, row: SubmissionRow) -> AppResult<SubmissionBody> {
    const MOST: i64 = 10_000;
    let entry = state.suite(&row.suite_id).await?;
    let waits = row.state == SubmissionState::Queued;
    let before = if waits { state.store.jobs_before(&row.id, MOST).await? } else { None };
    let pace = state.store.seconds_a_job();
    let estimated_seconds = before.zip(pace).map(|(before, pace)| ((before + 1) as f64 * pace * 10.0).round() / 10.0);
    Ok(SubmissionBody { queued_before: before, estimated_seconds, ..SubmissionBody::of(row, &entry) })
}

/// Cancels a submission that is queued or being graded. It ends as `cancelled`, and its task may be answered again.
#[utoipa::path(
    post, path = "/v1/submissions/{id}/cancel", operation_id = "cancel_submission", tag = "submissions",
    summary = "Cancel a submission",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The submission; its state is cancelled", body = SubmissionBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "state": "cancelled" })),
        (status = 409, description = "It has ended already"),
    )
)]
pub async fn cancel_submission(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<SubmissionBody>> {
    caller.require(Scope::Submit)?;
    let row = stored(&state, &id).await?;
    caller.require_own(row.owner.as_deref(), "submission")?;
    if !state.store.cancel(&id, now_ms()).await? {
        let row = stored(&state, &id).await?;
        let detail = format!("the submission has ended: {}", row.state.name());
        // Cancelling again succeeds as well.
        if row.state != SubmissionState::Cancelled {
            return Err(AppError::conflict("ended", detail));
        }
    }
    let row = stored(&state, &id).await?;
    Ok(Json(body_of(&state, row).await?))
}
