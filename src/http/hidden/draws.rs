//! The draw of the instances of an entry's runs.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use super::entries::{not_open, own_entry};
use super::epochs::stored_epoch;
use super::instances::InstanceBody;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::clock::now_ms;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::state::AppState;
use crate::store::instances::Issued;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

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
    let entry = own_entry(&state, &caller, &id).await?;
    let (least, most) = (LIMITS.nonce_min_chars, LIMITS.nonce_max_chars);
    if !(least..=most).contains(&new.nonce.chars().count()) || new.nonce.chars().any(char::is_control) {
        let mut faults = Faults::new();
        faults.add_at("nonce", format!("expected {least} to {most} characters"));
        return Err(AppError::faulty(faults));
    }
    let epoch = stored_epoch(&state, &entry.epoch_id).await?;
    let now = now_ms();
    let Some(secret) = state.store.epoch_secret(&epoch, now).await? else {
        return Err(AppError::conflict("key-lost", crate::store::epochs::LOST_KEY));
    };
    match state.store.issue_instances(&id, new.run, &new.nonce, &secret, now).await? {
        Issued::Instances(rows) => {
            let mut instances = Vec::with_capacity(rows.len());
            for row in rows {
                instances.push(InstanceBody::of(&state, row).await?);
            }
            Ok(Json(InstanceList { instances }))
        }
        Issued::NoSuchRun => {
            let mut faults = Faults::new();
            faults.add_at("run", format!("out of range: the entry has {} runs", entry.runs));
            Err(AppError::faulty(faults))
        }
        Issued::OtherNonce => {
            Err(AppError::conflict("already-drawn", "the run has already been drawn, with another nonce"))
        }
        Issued::Closed if entry.finalized_at_ms.is_some() => {
            Err(AppError::conflict("finalized", "the entry is finalized"))
        }
        Issued::Closed => Err(not_open(&epoch)),
        Issued::Exhausted => {
            let detail =
                "the reservation of this run has ended, and the epoch's pool has no room for it; nothing was issued";
            Err(AppError::conflict("pool-used-up", detail))
        }
        Issued::ShareUsedUp(most) => {
            let detail = format!(
                "the reservation of this run has ended, and the owner holds the maximum of {most} runs of the pool; \
                 nothing was issued"
            );
            Err(AppError::conflict("share-used-up", detail))
        }
    }
}
