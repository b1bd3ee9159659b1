//! One submission: reading its state and its position in the queue, and cancelling it.

use axum::Json;
use axum::extract::{Path, State};

use super::body::SubmissionBody;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::submissions::cancel::cancel;
use crate::app::submissions::read::{SubmissionStatus, status};
use crate::http::state::AppState;

fn body(
    SubmissionStatus { row, entry, queued_before, estimated_seconds }: SubmissionStatus,
) -> AppResult<SubmissionBody> {
    Ok(SubmissionBody { queued_before, estimated_seconds, ..SubmissionBody::of(row, &entry)? })
}

/// Returns a submission.
///
/// A submission has its state and, once graded, its verdict.
#[utoipa::path(
    get, path = "/v1/submissions/{id}", operation_id = "get_submission", tag = "submissions", summary = "Get a submission",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The submission", body = SubmissionBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "state": "graded", "overall": true })),
    )
)]
pub async fn get_submission(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<SubmissionBody>> {
    Ok(Json(body(status(&state, &id).await?)?))
}

/// Cancels a submission.
///
/// The submission must be queued or being graded. It ends as `cancelled`, and its task may be answered again.
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
    Ok(Json(body(cancel(&state, &caller, &id).await?)?))
}
