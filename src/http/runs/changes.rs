//! Ending a run: finishing it, with the tasks that it skips, or deleting it while it is open.

use axum::Json;
use axum::extract::{Path, State};

use super::resource::RunBody;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::runs::body::FinishBody;
use crate::app::runs::changes::{delete, finish};
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// Finishes a run.
///
/// Finishing declares that no more submissions will come, and which tasks are skipped on purpose. Tasks without a
/// submission count as failed. The run finishes when all its submissions have been graded. The body is optional.
#[utoipa::path(
    post, path = "/v1/runs/{id}/finish", operation_id = "finish_run", tag = "runs", summary = "Finish a run",
    params(("id" = String, Path, description = "The run's id")),
    request_body(content = Option<FinishBody>, content_type = "application/json"),
    responses(
        (status = 409, description = "It was deleted, or finished before with other tasks skipped"),
        (status = 200, description = "The run; its state is finishing or finished", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finishing", "pending": 2 })),
    )
)]
pub async fn finish_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: Option<JsonBody>,
) -> AppResult<Json<RunBody>> {
    // A caller without the scope is refused before the body is read.
    caller.require(Scope::Submit)?;
    let (draft, faults) = match &body {
        Some(body) => read_draft::<FinishBody>(body, "finish one run per request")?,
        None => (Some(FinishBody::default()), Faults::new()),
    };
    Ok(Json(RunBody::seen_by(Some(&caller), finish(&state, &caller, &id, draft, faults).await?)))
}

/// Deletes a run that is still open.
///
/// The run's pending submissions are cancelled, and only `state=deleted` lists it. Reports and receipts of its graded
/// submissions stay, and the board still counts it among the runs that the agent has begun. A finished run cannot be
/// deleted; its owner may withdraw it.
#[utoipa::path(
    delete, path = "/v1/runs/{id}", operation_id = "delete_run", tag = "runs", summary = "Delete an open run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The deleted run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "deleted", "pending": 0 })),
        (status = 409, description = "It is not open any more"),
    )
)]
pub async fn delete_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<RunBody>> {
    Ok(Json(RunBody::seen_by(Some(&caller), delete(&state, &caller, &id).await?)))
}
