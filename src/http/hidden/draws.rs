//! The draw of the instances of an entry's runs.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use super::instances::InstanceBody;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::hidden::draws::draw_run;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::state::AppState;
use crate::store::keys::Scope;

/// Request to draw the instances of a run.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "run": 1, "nonce": "8c1f0d3e5b7a4f6d9e2c" }))]
pub struct NewDraw {
    /// Number of the run within the entry, from 1.
    #[schema(minimum = 1)]
    run: u32,
    /// Random characters chosen by the client. The draw depends on the nonce and on the epoch's key, so neither side
    /// alone can control it.
    nonce: String,
}

/// Instances of a run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct InstanceList {
    /// Instances, in the order of issue.
    pub instances: Vec<InstanceBody>,
}

/// Draws the instances of a run. Repeating the request with the same nonce returns the same instances; a different
/// nonce is rejected. Each instance must be answered with one log before it expires.
#[utoipa::path(
    post, path = "/v1/entries/{id}/instances", operation_id = "create_instances", tag = "hidden evaluation",
    summary = "Draw a run's instances",
    params(("id" = String, Path, description = "The entry's id")),
    request_body(content = NewDraw, content_type = "application/json"),
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
    let new: NewDraw = read_json(&body)?;
    let instances = draw_run(&state, &caller, &id, new.run, &new.nonce).await?;
    Ok(Json(InstanceList { instances: instances.into_iter().map(InstanceBody::from).collect() }))
}
