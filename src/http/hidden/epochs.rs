//! Epochs: their commitments, their current state, and what they reveal after they close.

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use futures_util::TryStreamExt as _;
use serde::Serialize;

use crate::app::error::AppResult;
use crate::app::hidden::body::NewRoundBody;
use crate::app::hidden::epochs::{self, EpochStatus, RevealedAnswer};
use crate::app::hidden::pools::take_round;
use crate::clock::{now_ms, rfc3339};
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use plumbline_engine::hidden::beacon::BoundPool;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::feedback::{Feedback, Tier};

/// State of an epoch.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EpochState {
    /// The commitment is published; the epoch is not open yet.
    Committed,
    /// The epoch accepts entries.
    Open,
    /// The epoch is over.
    Closed,
}

/// An epoch.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpochBody {
    /// Name of the epoch.
    #[schema(example = "2026-11")]
    pub id: String,
    /// State of the epoch: `committed` (not open yet), `open` (accepts entries) or `closed`.
    #[schema(value_type = EpochState, example = "open")]
    pub state: &'static str,
    /// Time at which the epoch opens.
    #[schema(format = DateTime)]
    pub opens_at: String,
    /// Time at which the epoch closes as scheduled.
    #[schema(format = DateTime)]
    pub closes_at: String,
    /// Commitment published before the epoch opened. Keep it to verify the reveal.
    pub commitment: Commitment,
    /// The pool, published right after the beacon's round; absent before it, and for an epoch without a beacon, whose
    /// root is in the commitment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pool: Option<BoundPool>,
    /// Time until which official entries are registered, the time of the beacon's round; absent for an epoch without a
    /// beacon, which takes entries as long as it is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(format = DateTime)]
    pub registration_closes_at: Option<String>,
    /// Time at which the commitment was published.
    #[schema(format = DateTime)]
    pub committed_at: String,
    /// Time at which the epoch was closed early; null if it was not.
    #[schema(format = DateTime)]
    pub closed_early_at: Option<String>,
    /// Reason for closing the epoch early; null if it was not.
    pub closed_reason: Option<String>,
    /// Time limit for answering an instance, in seconds.
    pub instance_seconds: i64,
    /// Maximum number of dev entries per owner.
    pub dev_entries_per_owner: i64,
    /// Maximum number of official entries per owner.
    pub official_entries_per_owner: i64,
    /// Information that may be released before the epoch closes, in bits.
    pub budget_bits: f64,
    /// Upper bound on the information released so far, in bits.
    pub released_bits: f64,
    /// Number of registered entries, by tier.
    pub entries: EntryCounts,
    /// Number of issued instances, without siblings.
    pub issued: i64,
    /// Number of answered instances, without siblings.
    pub answered: i64,
    /// Number of issued siblings; absent for epochs without them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub siblings_issued: Option<i64>,
    /// Number of answered siblings; absent for epochs without them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub siblings_answered: Option<i64>,
    /// Feedback on entries while the epoch is open, by tier.
    pub feedback: TierFeedback,
}

/// Number of entries, by tier.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EntryCounts {
    /// Number of entries in the dev tier.
    pub dev: i64,
    /// Number of entries in the official tier.
    pub official: i64,
}

/// Feedback, by tier.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TierFeedback {
    /// Feedback on the public suite, which needs no entry.
    pub open: Feedback,
    /// Feedback on dev entries.
    pub dev: Feedback,
    /// Feedback on official entries.
    pub official: Feedback,
}

/// All epochs.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpochList {
    /// Epochs, latest opening time first.
    pub epochs: Vec<EpochBody>,
}

impl From<EpochStatus> for EpochBody {
    fn from(EpochStatus { row, counts, state }: EpochStatus) -> Self {
        let commitment = &row.commitment;
        let early = row.closed.as_ref().filter(|(at, _)| *at < commitment.closes_at_ms);
        let has_siblings = commitment.siblings.is_some();
        Self {
            id: row.id().to_owned(),
            state,
            opens_at: rfc3339(commitment.opens_at_ms),
            closes_at: rfc3339(commitment.closes_at_ms),
            pool: row.pool.clone(),
            registration_closes_at: commitment.beacon.as_ref().map(|beacon| rfc3339(beacon.emitted_at_ms())),
            committed_at: rfc3339(row.created_at_ms),
            closed_early_at: early.map(|(at, _)| rfc3339(*at)),
            closed_reason: early.map(|(_, reason)| reason.clone()),
            instance_seconds: row.rules.instance_ms / 1_000,
            dev_entries_per_owner: row.rules.dev_entries,
            official_entries_per_owner: row.rules.official_entries,
            budget_bits: row.rules.budget_bits,
            released_bits: (row.released_bits * 10.0).round() / 10.0,
            entries: EntryCounts { dev: counts.dev, official: counts.official },
            issued: counts.issued,
            answered: counts.answered,
            siblings_issued: has_siblings.then_some(counts.siblings),
            siblings_answered: has_siblings.then_some(counts.siblings_answered),
            feedback: TierFeedback {
                open: Feedback::Full,
                dev: Tier::Dev.feedback(commitment.dev_feedback),
                official: Tier::Official.feedback(commitment.dev_feedback),
            },
            commitment: row.commitment,
        }
    }
}

/// Lists all epochs.
///
/// Each epoch comes with its commitment.
#[utoipa::path(
    get, path = "/v1/epochs", operation_id = "list_epochs", tag = "hidden evaluation", summary = "List epochs",
    responses(
        (status = 200, description = "The epochs", body = EpochList, example = json!({ "epochs": [] })),
    )
)]
pub async fn list_epochs(State(state): State<AppState>) -> AppResult<Json<EpochList>> {
    let epochs = epochs::epochs(&state).await?.into_iter().map(EpochBody::from).collect();
    Ok(Json(EpochList { epochs }))
}

/// Returns an epoch.
///
/// An epoch has its commitment, its rules and its current state.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}", operation_id = "get_epoch", tag = "hidden evaluation", summary = "Get an epoch",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "The epoch", body = EpochBody,
         example = json!({ "id": "2026-11", "state": "open", "commitment": { "key_hash": "5891b5b5…", "root": "e258d248…" } })),
    )
)]
pub async fn get_epoch(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Json<EpochBody>> {
    Ok(Json(epochs::epoch(&state, &epoch).await?.into()))
}

/// Takes the round of a beacon.
///
/// The epoch that is bound to it gets its pool. Anybody may bring the round, without a key: it is public, and its
/// signature says that it is the right one. Repeating the request changes nothing.
#[utoipa::path(
    post, path = "/v1/epochs/{epoch}/beacon", operation_id = "create_epoch_pool", tag = "hidden evaluation",
    summary = "Bring a beacon's round",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    request_body(content = NewRoundBody, content_type = "application/json"),
    responses(
        (status = 200, description = "The epoch, with its pool", body = EpochBody,
         example = json!({ "id": "2026-11", "state": "open", "pool": { "round": 123, "root": "e258d248…" } })),
        (status = 409, description = "It is bound to no beacon, the round is not due yet, or the epoch is over"),
    )
)]
pub async fn create_epoch_pool(
    State(state): State<AppState>,
    Path(epoch): Path<String>,
    body: JsonBody,
) -> AppResult<Json<EpochBody>> {
    let (draft, faults) = read_draft::<NewRoundBody>(&body, "bring one round per request")?;
    Ok(Json(take_round(&state, &epoch, draft, faults, now_ms()).await?.into()))
}

/// Reveals a closed epoch.
///
/// The response has everything that the epoch kept secret: key, salts, specifications, entries, draws and grades.
/// `plumbline verify-epoch` recomputes everything from the key and compares.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/reveal", operation_id = "get_epoch_reveal", tag = "hidden evaluation",
    summary = "Reveal a closed epoch",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "The reveal", body = Object,
         example = json!({ "key": "6f1e…", "specifications": [{ "leaf": 0, "salt": "9a0c…", "hash": "77de…" }] })),
        (status = 409, description = "It is not over, or its last answers are being graded"),
    )
)]
pub async fn get_epoch_reveal(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Response> {
    let json = [(header::CONTENT_TYPE, "application/json")];
    // A reveal never changes once it could be made.
    if let Some(made) = state.reveals.get(&epoch) {
        return Ok((json, made).into_response());
    }
    let text = Bytes::from(epochs::reveal(&state, &epoch).await?);
    state.reveals.insert(epoch, text.clone());
    Ok((json, text).into_response())
}

/// Returns the answers of a closed epoch.
///
/// The answers are the logs for the epoch's instances, one per line. `plumbline verify-epoch` grades them again.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/answers", operation_id = "get_epoch_answers", tag = "hidden evaluation",
    summary = "Download a closed epoch's answers",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "One JSON object per line, with instance and log", body = String, content_type = "application/x-ndjson",
         example = "{\"instance\":\"5f0c…\",\"log\":{\"palette\":[\"stone\"],\"turns\":[[[0,0,0,0]]]}}\n"),
        (status = 409, description = "It is not over"),
    )
)]
pub async fn get_epoch_answers(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Response> {
    let pages = epochs::revealed_answers(&state, &epoch).await?;
    let lines = pages.map_ok(|page| Bytes::from(ndjson(&page)));
    Ok(([(header::CONTENT_TYPE, "application/x-ndjson")], Body::from_stream(lines)).into_response())
}

/// Formats answers as lines of JSON.
fn ndjson(answers: &[RevealedAnswer]) -> Vec<u8> {
    let mut text = Vec::new();
    for RevealedAnswer { instance, log } in answers {
        text.extend(format!("{{\"instance\":\"{instance}\",\"log\":").bytes());
        text.extend(log);
        text.extend(b"}\n");
    }
    text
}
