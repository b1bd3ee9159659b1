//! Entries to an epoch. An entry is registered before its owner sees any instance, then drawn, answered and finalized.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use serde_json::Value;

use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::hidden::body::NewEntryBody;
use crate::app::hidden::entries::{self, EntryStatus, RegisteredEntry};
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::extract::idempotency;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::feedback::Tier;

/// An entry, with as much of its result as the feedback of its tier allows.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EntryBody {
    /// Identifier of the entry.
    #[schema(format = Uuid)]
    pub id: String,
    /// Name of the epoch.
    pub epoch: String,
    /// Name of the evaluated agent.
    pub agent: String,
    /// SHA-256 of the agent's configuration.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub configuration_sha256: String,
    /// Tier of the entry.
    pub tier: Tier,
    /// Number of registered runs.
    #[schema(minimum = 0)]
    pub runs: i64,
    /// State of the entry: `registered`, `finalized` (answers are being graded) or `complete`.
    #[schema(value_type = EntryState, example = "registered")]
    pub state: &'static str,
    /// Time of registration.
    #[schema(format = DateTime)]
    pub registered_at: String,
    /// Time of finalization; null before it.
    #[schema(format = DateTime)]
    pub finalized_at: Option<String>,
    /// Number of issued instances, with siblings.
    pub issued: usize,
    /// Number of answered instances, with siblings.
    pub answered: usize,
    /// Result, as far as it is released; null until the entry is complete, and until the epoch closes if its tier gives
    /// no feedback before. `passed` of `of` instances, their share as `overall`, and `told_later`: how many more are
    /// told when the epoch is over. Then also `siblings` with its `passed` and `of`, and `instances`, with `sibling`
    /// where one is; `criteria` counts answered instances alone, without siblings.
    #[schema(value_type = Option<Object>)]
    pub result: Value,
    /// Receipt of the registration, returned only in the response to the registration. Keep it as proof of what was
    /// registered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receipt: Option<GivenReceipt>,
}

/// State of an entry.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EntryState {
    /// Instances may be drawn and answered.
    Registered,
    /// Answers are being graded.
    Finalized,
    /// The result is final.
    Complete,
}

impl From<EntryStatus> for EntryBody {
    fn from(EntryStatus { row, state, issued, answered, result }: EntryStatus) -> Self {
        Self {
            state,
            issued,
            answered,
            registered_at: rfc3339(row.registered_at_ms),
            finalized_at: row.finalized_at_ms.map(rfc3339),
            id: row.id,
            epoch: row.epoch_id,
            agent: row.agent,
            configuration_sha256: row.configuration_hash,
            tier: row.tier,
            runs: i64::from(row.runs),
            result,
            receipt: None,
        }
    }
}

/// Registers an entry.
///
/// An entry is registered before any instance is seen. It fixes the evaluated agent, its configuration and the number
/// of runs. All official entries of an owner in an epoch must have the same agent and configuration; they are pooled.
#[utoipa::path(
    post, path = "/v1/epochs/{epoch}/entries", operation_id = "create_entry", tag = "hidden evaluation",
    summary = "Register an entry",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11"),
           ("Idempotency-Key" = Option<String>, Header, description = "Makes retries safe: for 24 hours, the same request with the same key is carried out once, and its response is repeated")),
    request_body(content = NewEntryBody, content_type = "application/json"),
    responses(
        (status = 201, description = "The entry", body = EntryBody, headers(("Location" = String, description = "URL of the entry")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000003", "epoch": "2026-11", "tier": "official", "state": "registered" })),
        (status = 409, description = "It is not open, its pool is used up, the owner has no entries left, or an official entry of another configuration"),
    )
)]
pub async fn create_entry(
    State(state): State<AppState>,
    caller: Caller,
    Path(epoch): Path<String>,
    headers: HeaderMap,
    body: JsonBody,
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    let underway = state.in_flight.begin(&headers, &caller, &format!("create_entry {epoch}"), &body.bytes)?;
    let (draft, faults) = read_draft::<NewEntryBody>(&body, "register one entry per request")?;
    let once = underway.as_ref().map(|underway| &underway.once);
    let RegisteredEntry { entry, receipt, is_replayed } =
        entries::register_entry(&state, &caller, &epoch, draft, faults, once).await?;
    let body = EntryBody { receipt, ..entry.into() };
    let location = format!("/v1/entries/{}", body.id);
    let mut response = (StatusCode::CREATED, [(header::LOCATION, location)], Json(body)).into_response();
    if is_replayed {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

/// Returns an entry.
///
/// An entry has its state and, as far as it is released, its result.
#[utoipa::path(
    get, path = "/v1/entries/{id}", operation_id = "get_entry", tag = "hidden evaluation", summary = "Get an entry",
    params(("id" = String, Path, description = "The entry's id")),
    responses(
        (status = 200, description = "The entry", body = EntryBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000003", "state": "complete", "result": { "passed": 20, "of": 26 } })),
    )
)]
pub async fn get_entry(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<EntryBody>> {
    Ok(Json(entries::entry(&state, &id).await?.into()))
}

/// Finalizes an entry.
///
/// The entry then takes no more answers. Unanswered instances and runs that were not drawn count as failed. This
/// cannot be undone.
#[utoipa::path(
    post, path = "/v1/entries/{id}/finalize", operation_id = "finalize_entry", tag = "hidden evaluation",
    summary = "Finalize an entry",
    params(("id" = String, Path, description = "The entry's id")),
    responses(
        (status = 200, description = "The entry", body = EntryBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000003", "state": "finalized", "result": null })),
    )
)]
pub async fn finalize_entry(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<EntryBody>> {
    Ok(Json(entries::finalize_entry(&state, &caller, &id).await?.into()))
}
