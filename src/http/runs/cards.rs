//! Cards of runs and of entries.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use crate::app::access::Caller;
use crate::app::cards::card::{Card, SystemPrompt};
use crate::app::cards::reading::read_card;
use crate::app::cards::{put, versions};
use crate::app::error::{AppError, AppResult};
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::cards::{CardOf, CardRow};
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// A version of a card.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CardVersion {
    /// Number of the version, from 1.
    #[schema(minimum = 1)]
    pub version: i64,
    /// The card.
    pub card: Card,
    /// Owner of the key that it was sent with; null if it was sent without a key.
    pub actor: Option<String>,
    /// Time of the edit.
    #[schema(format = DateTime)]
    pub at: String,
}

/// The card of a run or an entry, with its history.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CardBody {
    /// Versions, latest first. The first of them is the card as it stands.
    pub versions: Vec<CardVersion>,
}

/// Query of a card.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CardQuery {
    /// Whether to show the text of the system prompt, where it was given.
    #[serde(default)]
    prompt: bool,
}

impl CardBody {
    fn of(rows: Vec<CardRow>, with_prompt: bool) -> AppResult<Self> {
        let shown = |row: CardRow| {
            let mut card: Card = serde_json::from_value(row.card).map_err(|error| AppError::internal(&error))?;
            if with_prompt && row.system_prompt.is_some() {
                card.system_prompt.get_or_insert_with(SystemPrompt::default).text = row.system_prompt;
            }
            Ok(CardVersion { version: row.version, card, actor: row.actor, at: rfc3339(row.created_at_ms) })
        };
        Ok(Self { versions: rows.into_iter().map(shown).collect::<AppResult<_>>()? })
    }
}

async fn put_card(state: &AppState, caller: &Caller, of: CardOf<'_>, body: &JsonBody) -> AppResult<Json<CardBody>> {
    caller.require(Scope::Submit)?;
    let mut faults = Faults::new();
    let card = read_card(&read_json(body)?, &mut faults);
    Ok(Json(CardBody::of(put(state, caller, of, card, faults).await?, false)?))
}

/// Declares what a run was.
///
/// The card has its agent, harness, model, sampling, tokens and cost. It may be edited at any time, also after the run
/// has finished; every version stays in its history.
#[utoipa::path(
    put, path = "/v1/runs/{id}/card", operation_id = "put_run_card", tag = "runs", summary = "Declare what a run was",
    params(("id" = String, Path, description = "The run's id")),
    request_body(content = Card, content_type = "application/json"),
    responses(
        (status = 200, description = "The card with its history", body = CardBody,
         example = json!({ "versions": [{ "version": 1, "card": { "agent_version": "1.2" }, "actor": "lab", "at": "2026-11-01T00:00:00.000Z" }] })),
        (status = 409, description = "It has too many versions"),
    )
)]
pub async fn put_run_card(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<CardBody>> {
    put_card(&state, &caller, CardOf::Run(&id), &body).await
}

/// Returns the card of a run.
///
/// The card comes with its history.
#[utoipa::path(
    get, path = "/v1/runs/{id}/card", operation_id = "get_run_card", tag = "runs", summary = "Get a run's card",
    params(("id" = String, Path, description = "The run's id"), CardQuery),
    responses(
        (status = 200, description = "The card with its history", body = CardBody, example = json!({ "versions": [] })),
        (status = 404, description = "There is no such run, or it has no card"),
    )
)]
pub async fn get_run_card(
    State(state): State<AppState>,
    caller: AppResult<Caller>,
    Path(id): Path<String>,
    Params(query): Params<CardQuery>,
) -> AppResult<Json<CardBody>> {
    Ok(Json(CardBody::of(versions(&state, caller.ok().as_ref(), CardOf::Run(&id)).await?, query.prompt)?))
}

/// Declares what an entry was.
///
/// This is a card like that of a run.
#[utoipa::path(
    put, path = "/v1/entries/{id}/card", operation_id = "put_entry_card", tag = "hidden evaluation",
    summary = "Declare what an entry was",
    params(("id" = String, Path, description = "The entry's id")),
    request_body(content = Card, content_type = "application/json"),
    responses(
        (status = 200, description = "The card with its history", body = CardBody,
         example = json!({ "versions": [{ "version": 1, "card": { "agent_version": "1.2" }, "actor": "lab", "at": "2026-11-01T00:00:00.000Z" }] })),
        (status = 409, description = "It has too many versions"),
    )
)]
pub async fn put_entry_card(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<CardBody>> {
    put_card(&state, &caller, CardOf::Entry(&id), &body).await
}

/// Returns the card of an entry.
///
/// The card comes with its history.
#[utoipa::path(
    get, path = "/v1/entries/{id}/card", operation_id = "get_entry_card", tag = "hidden evaluation",
    summary = "Get an entry's card",
    params(("id" = String, Path, description = "The entry's id"), CardQuery),
    responses(
        (status = 200, description = "The card with its history", body = CardBody, example = json!({ "versions": [] })),
        (status = 404, description = "There is no such entry, or it has no card"),
    )
)]
pub async fn get_entry_card(
    State(state): State<AppState>,
    caller: AppResult<Caller>,
    Path(id): Path<String>,
    Params(query): Params<CardQuery>,
) -> AppResult<Json<CardBody>> {
    Ok(Json(CardBody::of(versions(&state, caller.ok().as_ref(), CardOf::Entry(&id)).await?, query.prompt)?))
}
