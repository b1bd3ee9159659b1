//! Epochs: their commitments, their current state, and what they reveal after they close.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use futures_util::stream;
use serde::Serialize;

use crate::app::error::{AppError, AppResult};
use crate::clock::{now_ms, rfc3339};
use crate::http::state::AppState;
use crate::store::StoreError;
use crate::store::entries::EntryRow;
use crate::store::epochs::EpochRow;
use crate::store::secrets::EpochSecret;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::feedback::{Feedback, Outcome, Tier};
use plumbline_engine::hidden::reveal::{Reveal, RevealedEntry, RevealedInstance, revealed};

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
    /// Number of issued instances.
    pub issued: i64,
    /// Number of answered instances.
    pub answered: i64,
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

/// Builds the representation of an epoch for the API and the pages.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn epoch_body(state: &AppState, row: &EpochRow) -> AppResult<EpochBody> {
    let counts = state.store.epoch_counts(row.id()).await?;
    let commitment = &row.commitment;
    let early = row.closed.as_ref().filter(|(at, _)| *at < commitment.closes_at_ms);
    Ok(EpochBody {
        id: row.id().to_owned(),
        state: row.state(now_ms()),
        opens_at: rfc3339(commitment.opens_at_ms),
        closes_at: rfc3339(commitment.closes_at_ms),
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
        feedback: TierFeedback {
            open: Feedback::Full,
            dev: Tier::Dev.feedback(commitment.dev_feedback),
            official: Tier::Official.feedback(commitment.dev_feedback),
        },
        commitment: commitment.clone(),
    })
}

/// Returns the epoch with this name.
///
/// # Errors
/// Returns an error (404) if there is none.
pub async fn stored_epoch(state: &AppState, id: &str) -> AppResult<EpochRow> {
    let row = state.store.epoch(id).await?;
    row.ok_or_else(|| AppError::not_found(format!("there is no epoch {id:?}; /v1/epochs lists them")))
}

/// Lists all epochs with their commitments.
#[utoipa::path(
    get, path = "/v1/epochs", operation_id = "list_epochs", tag = "hidden evaluation", summary = "List epochs",
    responses(
        (status = 200, description = "The epochs", body = EpochList, example = json!({ "epochs": [] })),
    )
)]
pub async fn list_epochs(State(state): State<AppState>) -> AppResult<Json<EpochList>> {
    let mut epochs = Vec::new();
    for row in state.store.epochs().await? {
        epochs.push(epoch_body(&state, &row).await?);
    }
    Ok(Json(EpochList { epochs }))
}

/// Returns an epoch with its commitment, rules and current state.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}", operation_id = "get_epoch", tag = "hidden evaluation", summary = "Get an epoch",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "The epoch", body = EpochBody,
         example = json!({ "id": "2026-11", "state": "open", "commitment": { "key_hash": "5891b5b5…", "root": "e258d248…" } })),
    )
)]
pub async fn get_epoch(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Json<EpochBody>> {
    let row = stored_epoch(&state, &epoch).await?;
    Ok(Json(epoch_body(&state, &row).await?))
}

/// Returns the epoch and its secret if the epoch is over, fully graded, and its key is available.
async fn sealed_epoch(state: &AppState, id: &str) -> AppResult<(EpochRow, Arc<EpochSecret>)> {
    let row = stored_epoch(state, id).await?;
    let now = now_ms();
    if !row.is_over(now) {
        let detail =
            format!("the epoch closes at {}; nothing is revealed before that", rfc3339(row.commitment.closes_at_ms));
        return Err(AppError::conflict("epoch-not-over", detail));
    }
    if row.settled_at_ms.is_none() {
        let detail = "the epoch is over; its last answers are being graded, and then its results are sealed";
        return Err(AppError::conflict("still-grading", detail).retry_after(1));
    }
    let secret = state.store.epoch_secret(&row, now).await?;
    let lost = || AppError::conflict("key-lost", crate::store::epochs::LOST_KEY);
    Ok((row, secret.ok_or_else(lost)?))
}

fn revealed_entry(row: EntryRow) -> RevealedEntry {
    RevealedEntry {
        id: row.id,
        agent: row.agent,
        configuration_hash: row.configuration_hash,
        tier: row.tier,
        runs: row.runs,
        registered_at_ms: row.registered_at_ms,
        finalized_at_ms: row.finalized_at_ms,
        owner: Some(row.owner),
        completed_at_ms: row.completed_at_ms,
    }
}

/// Returns everything that a closed epoch kept secret: key, salts, specifications, entries, draws and grades.
/// `plumbline verify-epoch` recomputes everything from the key and compares.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/reveal", operation_id = "get_epoch_reveal", tag = "hidden evaluation",
    summary = "Reveal a closed epoch",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "The reveal", body = Object,
         example = json!({ "key": "6f1e…", "specifications": [{ "leaf": 0, "salt": "9a0c…", "hash": "77de…" }] })),
        (status = 409, description = "It is not over, its last answers are being graded, or its key was lost"),
    )
)]
pub async fn get_epoch_reveal(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Response> {
    let (row, secret) = sealed_epoch(&state, &epoch).await?;
    let json = [(header::CONTENT_TYPE, "application/json")];
    if let Some(made) = state.reveals.get(&epoch) {
        return Ok((json, made).into_response());
    }
    let entries = state.store.entries(row.id()).await?;
    let mut grades: BTreeMap<String, Outcome> = BTreeMap::new();
    for entry in &entries {
        let outcomes = state.store.outcomes_of_entry(&entry.id).await?;
        grades.extend(outcomes.into_iter().map(|outcome| (outcome.instance.clone(), outcome)));
    }
    let rows = state.store.instances_of_epoch(row.id()).await?;
    let instances = rows.into_iter().map(|own| {
        let scores = grades.remove(&own.id).and_then(|outcome| outcome.scores);
        RevealedInstance {
            ordinal: own.ordinal,
            entry: own.entry_id,
            nonce: own.nonce,
            run: own.run,
            family: own.family,
            index: own.family_index,
            leaf: own.leaf,
            log_sha256: own.log_hash,
            overall: scores.as_ref().map(plumbline_engine::grading::ProblemScores::overall),
            scores: scores.map(|scores| scores.rows),
            transcript_sha256: own.transcript_hash,
            transcript_checked: own.transcript_checked_ms.is_some(),
            id: own.id,
        }
    });
    let instances: Vec<RevealedInstance> = instances.collect();
    let entries = entries.into_iter().map(revealed_entry).collect();
    let receipts = Some(state.store.receipts_of_epoch(row.id()).await?);
    let made = tokio::task::spawn_blocking(move || {
        let specifications = secret.specifications.iter().map(|own| revealed(&secret.key, own.clone())).collect();
        let reveal = Reveal {
            commitment: row.commitment,
            key: secret.key.expose(),
            specifications,
            entries,
            instances,
            receipts,
        };
        serde_json::to_vec(&reveal)
    });
    let text = made.await.map_err(|error| AppError::internal(&error))?.map_err(|error| AppError::internal(&error))?;
    let text = Bytes::from(text);
    state.reveals.insert(epoch, text.clone());
    Ok((json, text).into_response())
}

/// Returns the logs that answered a closed epoch's instances, one per line. `plumbline verify-epoch` grades them again.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/answers", operation_id = "get_epoch_answers", tag = "hidden evaluation",
    summary = "Download a closed epoch's answers",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11")),
    responses(
        (status = 200, description = "One JSON object per line, with instance and log", body = String, content_type = "application/x-ndjson",
         example = "{\"instance\":\"5f0c…\",\"log\":{\"palette\":[\"stone\"],\"turns\":[[[0,0,0,0]]]}}\n"),
        (status = 409, description = "It is not over, or its key was lost"),
    )
)]
pub async fn get_epoch_answers(State(state): State<AppState>, Path(epoch): Path<String>) -> AppResult<Response> {
    const AT_ONCE: i64 = 10;
    let (row, _secret) = sealed_epoch(&state, &epoch).await?;
    let lines = stream::try_unfold((state, row, 0), |(state, row, after)| async move {
        let page = state.store.answers(row.id(), after, AT_ONCE).await?;
        let Some((last, _, _)) = page.last() else { return Ok::<_, StoreError>(None) };
        let last = *last;
        let mut text = Vec::new();
        for (_, instance, log) in &page {
            text.extend(format!("{{\"instance\":\"{instance}\",\"log\":").bytes());
            text.extend(log);
            text.extend(b"}\n");
        }
        Ok(Some((Bytes::from(text), (state, row, last))))
    });
    Ok(([(header::CONTENT_TYPE, "application/x-ndjson")], Body::from_stream(lines)).into_response())
}
