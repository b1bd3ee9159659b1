//! What an owner decides about a run in public: withdrawing it, and lifting its embargo.

use axum::Json;
use axum::extract::{Path, State};

use super::resource::RunBody;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::runs::body::WithdrawalBody;
use crate::app::runs::publicity;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::Scope;

/// Withdraws a finished run from its board.
///
/// This cannot be undone. The board lists the run among those withdrawn, with time and reason, and still counts it
/// among the runs that the agent has begun. Its submissions, reports and receipts stay. An open run is deleted
/// instead.
#[utoipa::path(
    post, path = "/v1/runs/{id}/withdraw", operation_id = "withdraw_run", tag = "runs", summary = "Withdraw a run",
    params(("id" = String, Path, description = "The run's id")),
    request_body(content = WithdrawalBody, content_type = "application/json"),
    responses(
        (status = 200, description = "The run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finished",
                           "withdrawn": { "at": "2026-11-21T07:00:00.000Z", "reason": "the harness cut answers off" } })),
        (status = 409, description = "It has not finished, or was withdrawn before"),
    )
)]
pub async fn withdraw_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<RunBody>> {
    // A caller without the scope is refused before the body is read.
    caller.require(Scope::Submit)?;
    let (draft, faults) = read_draft::<WithdrawalBody>(&body, "withdraw one run per request")?;
    Ok(Json(RunBody::seen_by(Some(&caller), publicity::withdraw(&state, &caller, &id, draft, faults).await?)))
}

/// Lifts the embargo of a run before its end.
///
/// From now on the run shows its agent, owner, card and metadata.
#[utoipa::path(
    delete, path = "/v1/runs/{id}/embargo", operation_id = "lift_embargo", tag = "runs",
    summary = "Lift an embargo early",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "agent": "my-agent 1.2", "state": "finished" })),
        (status = 409, description = "It is not under embargo"),
    )
)]
pub async fn lift_embargo(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<RunBody>> {
    Ok(Json(RunBody::seen_by(Some(&caller), publicity::lift(&state, &caller, &id).await?)))
}
