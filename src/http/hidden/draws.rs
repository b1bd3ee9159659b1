//! The draw of the instances of an entry's runs.

use axum::Json;
use axum::extract::{Path, State};
use serde::Serialize;

use super::instances::InstanceBody;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::hidden::body::NewDrawBody;
use crate::app::hidden::draws::{DrawProof, DrawnRun, draw_run};
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::hidden::evidence::GivenReceipt;

/// Instances of a run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct InstanceList {
    /// Instances, in the order of issue.
    pub instances: Vec<InstanceBody>,
    /// Proof that neither side chose them, which `plumbline verify-draw` checks against the commitment; absent in an
    /// epoch without a key of draws.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub draw: Option<DrawProof>,
    /// Signed statement of the draw: its instances, in order, and SHA-256 of the prompts of each. Keep it:
    /// `plumbline verify-draw` compares this response with it, and `verify-epoch --given` the reveal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receipt: Option<GivenReceipt>,
}

/// Draws the instances of a run.
///
/// Repeating the request with the same nonce returns the same instances; a different nonce is rejected. Each instance
/// must be answered with one log before it expires.
#[utoipa::path(
    post, path = "/v1/entries/{id}/instances", operation_id = "create_instances", tag = "hidden evaluation",
    summary = "Draw a run's instances",
    params(("id" = String, Path, description = "The entry's id")),
    request_body(content = NewDrawBody, content_type = "application/json"),
    responses(
        (status = 200, description = "The instances, with their prompts but without their checks", body = InstanceList,
         example = json!({ "instances": [{ "id": "5f0c…", "prompts": ["You stand at (0, 0, 0) …"], "expires_at": "2026-11-22T10:00:00.000Z" }] })),
        (status = 409, description = "Drawn with another nonce, finalized, the epoch not open, or its pool used up"),
    )
)]
pub async fn create_instances(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<InstanceList>> {
    caller.require(Scope::Submit)?;
    let (draft, faults) = read_draft::<NewDrawBody>(&body, "draw one run per request")?;
    let DrawnRun { instances, proof, receipt } = draw_run(&state, &caller, &id, draft, faults).await?;
    let instances = instances.into_iter().map(InstanceBody::from).collect();
    Ok(Json(InstanceList { instances, draw: proof, receipt }))
}
