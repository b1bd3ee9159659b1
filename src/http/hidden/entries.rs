//! Entries to an epoch. An entry is registered before its owner sees any instance, then drawn, answered and finalized.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use uuid::Uuid;

use super::epochs::stored_epoch;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::submissions::accept::key_reused;
use crate::clock::{now_ms, rfc3339};
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::extract::idempotency;
use crate::http::state::AppState;
use crate::store::entries::EntryRow;
use crate::store::epochs::EpochRow;
use crate::store::keys::Scope;
use crate::store::registration::{NewEntry, Registered};
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::feedback::{Outcome, Tier, told};
use plumbline_engine::intake::Faults;

/// Request to register an entry.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "agent": "my-agent 1.2", "tier": "official", "runs": 2,
                           "configuration_sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08" }))]
pub struct NewEntryBody {
    /// Name of the evaluated agent, as shown on boards.
    #[schema(min_length = 1)]
    agent: String,
    /// SHA-256 of everything that determines the agent: weights, prompts, sampling. Keep the hashed data.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    configuration_sha256: String,
    /// `dev` or `official`. The open tier, with full feedback, is the public suite: use `POST /v1/runs`.
    tier: Tier,
    /// Number of runs; each has its own draw.
    #[schema(minimum = 1)]
    runs: u32,
}

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
    /// Number of issued instances.
    pub issued: usize,
    /// Number of answered instances.
    pub answered: usize,
    /// Result, as far as it is released; null until the entry is complete, and until the epoch closes if its tier gives
    /// no feedback before.
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

/// Adds a failed outcome for each instance of the runs that were never drawn.
fn with_undrawn(mut outcomes: Vec<Outcome>, entry: &EntryRow, epoch: &EpochRow) -> Vec<Outcome> {
    let all = entry.runs as usize * epoch.commitment.instances_per_run as usize;
    while outcomes.len() < all {
        outcomes.push(Outcome { instance: String::new(), scores: None });
    }
    outcomes
}

async fn entry_body(state: &AppState, id: &str) -> AppResult<EntryBody> {
    let row = stored_entry(state, id).await?;
    let epoch = stored_epoch(state, &row.epoch_id).await?;
    let instances = state.store.instances_of_entry(id).await?;
    let mut result = Value::Null;
    if row.completed_at_ms.is_some() {
        let outcomes = with_undrawn(state.store.outcomes_of_entry(id).await?, &row, &epoch);
        result = told(row.tier.feedback(epoch.commitment.dev_feedback), epoch.closed.is_some(), &outcomes);
    }
    Ok(EntryBody {
        state: match (row.finalized_at_ms, row.completed_at_ms) {
            (_, Some(_)) => "complete",
            (Some(_), None) => "finalized",
            (None, None) => "registered",
        },
        issued: instances.len(),
        answered: instances.iter().filter(|own| own.submission_id.is_some()).count(),
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
    })
}

async fn stored_entry(state: &AppState, id: &str) -> AppResult<EntryRow> {
    let row = state.store.entry(id).await?;
    row.ok_or_else(|| AppError::not_found(format!("there is no entry {id:?}")))
}

/// Returns the entry if the caller may act on it.
///
/// # Errors
/// Returns an error if the entry belongs to another owner (403) or does not exist (404).
pub async fn own_entry(state: &AppState, caller: &Caller, id: &str) -> AppResult<EntryRow> {
    let row = stored_entry(state, id).await?;
    caller.require_own(Some(row.owner.as_str()).filter(|owner| !owner.is_empty()), "entry")?;
    Ok(row)
}

/// Registers an entry before any instance is seen: the evaluated agent, its configuration and the number of runs. All
/// official entries of an owner in an epoch must have the same agent and configuration; they are pooled.
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
    let new: NewEntryBody = read_json(&body)?;
    let row = stored_epoch(&state, &epoch).await?;
    let mut faults = Faults::new();
    let agent = new.agent.trim();
    if agent.is_empty() || agent.chars().count() > LIMITS.agent_chars {
        faults.add_at("agent", format!("expected 1 to {} characters", LIMITS.agent_chars));
    }
    let has_upper = new.configuration_sha256.bytes().any(|byte| byte.is_ascii_uppercase());
    if has_upper || unhex::<32>(&new.configuration_sha256).is_none() {
        faults.add_at("configuration_sha256", "expected 64 lower-case hexadecimal digits");
    }
    if new.runs == 0 || new.runs > LIMITS.entry_runs {
        faults.add_at("runs", format!("expected 1 to {}", LIMITS.entry_runs));
    }
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let id = Uuid::now_v7().to_string();
    let entry = NewEntry {
        id: &id,
        epoch_id: row.id(),
        owner: caller.owner().unwrap_or_default(),
        agent,
        configuration_hash: &new.configuration_sha256,
        tier: new.tier,
        runs: new.runs,
    };
    let once = underway.as_ref().map(|underway| &underway.once);
    let mut registered = id.clone();
    match state.store.register_entry(&entry, once, now_ms()).await? {
        Registered::New => {}
        Registered::Repeated(before) => registered = before,
        Registered::KeyUsedOtherwise => return Err(key_reused()),
        Registered::NotOpen => return Err(not_open(&row)),
        Registered::TooMany(most) => {
            let detail = format!(
                "the owner already has {most} entries of the tier {:?} in this epoch, the maximum",
                new.tier.name()
            );
            return Err(AppError::conflict("no-entries-left", detail));
        }
        Registered::PoolUsedUp => {
            let detail = "the epoch has too few specifications left; half of them are reserved for official entries";
            return Err(AppError::conflict("pool-used-up", detail));
        }
        Registered::ShareUsedUp(most) => {
            let detail = format!(
                "one owner may hold at most {most} runs of this epoch's pool, drawn or reserved; a reservation ends \
                 when its entry is finalized, or after {} s",
                row.rules.reservation_ms.unwrap_or_default() / 1_000
            );
            return Err(AppError::conflict("share-used-up", detail));
        }
        Registered::ConfigurationTaken => {
            let detail =
                "another owner has already entered this configuration in this epoch; only one owner may enter it";
            return Err(AppError::conflict("configuration-taken", detail));
        }
        Registered::OtherConfiguration(agent) => {
            let detail = format!(
                "the owner's official entries in this epoch have another agent or configuration (agent {agent:?}); \
                 official entries are pooled, so all of them must have the same"
            );
            return Err(AppError::conflict("another-configuration", detail));
        }
    }
    let location = format!("/v1/entries/{registered}");
    let mut body = entry_body(&state, &registered).await?;
    body.receipt = given(state.store.receipt_of_entry(&registered).await?.as_deref())?;
    let mut response = (StatusCode::CREATED, [(header::LOCATION, location)], Json(body)).into_response();
    if registered != id {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

/// Parses a stored receipt.
///
/// # Errors
/// Returns an error if the stored text is not a receipt.
pub fn given(stored: Option<&str>) -> AppResult<Option<GivenReceipt>> {
    stored.map(serde_json::from_str).transpose().map_err(|error| AppError::internal(&error))
}

/// Returns a 409 error that says why the epoch is not open.
pub fn not_open(epoch: &EpochRow) -> AppError {
    let detail = match &epoch.closed {
        Some((_, reason)) => format!("the epoch is closed: {reason}"),
        None => format!(
            "the epoch is open from {} to {}",
            rfc3339(epoch.commitment.opens_at_ms),
            rfc3339(epoch.commitment.closes_at_ms)
        ),
    };
    AppError::conflict("epoch-not-open", detail)
}

/// Returns an entry with its state and, as far as it is released, its result.
#[utoipa::path(
    get, path = "/v1/entries/{id}", operation_id = "get_entry", tag = "hidden evaluation", summary = "Get an entry",
    params(("id" = String, Path, description = "The entry's id")),
    responses(
        (status = 200, description = "The entry", body = EntryBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000003", "state": "complete", "result": { "passed": 20, "of": 26 } })),
    )
)]
pub async fn get_entry(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<EntryBody>> {
    Ok(Json(entry_body(&state, &id).await?))
}

/// Finalizes an entry, which then takes no more answers. Unanswered instances and runs that were not drawn count as
/// failed. This cannot be undone.
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
    caller.require(Scope::Submit)?;
    own_entry(&state, &caller, &id).await?;
    state.store.finalize_entry(&id, now_ms()).await?;
    Ok(Json(entry_body(&state, &id).await?))
}
