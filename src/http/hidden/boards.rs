//! Boards of epochs: the dev board, kept by the Ladder, and the official board.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use super::epochs::stored_epoch;
use crate::app::error::AppResult;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::entries::{BoardOutcome, EntryRow};
use crate::store::epochs::EpochRow;
use plumbline_engine::hidden::board;
use plumbline_engine::hidden::board::{Answered, Entrant, Row};
use plumbline_engine::hidden::feedback::{Feedback, Tier};

/// Query of an epoch's board.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EpochBoardQuery {
    /// Tier of the board: `official` (the default) or `dev`.
    tier: Option<Tier>,
    /// Only rows with this provenance.
    provenance: Option<String>,
}

/// The board of one tier of an epoch.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpochBoard {
    /// Name of the epoch.
    pub epoch: String,
    /// Tier of the board.
    pub tier: Tier,
    /// Whether scores are released; for the official tier, only after the epoch has closed.
    pub is_released: bool,
    /// Number of entries registered in this tier.
    pub registered: usize,
    /// Rows, best first; empty until scores are released.
    pub rows: Vec<Row>,
}

/// Returns the board of one tier of an epoch.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn board_of(state: &AppState, epoch: &EpochRow, tier: Tier) -> AppResult<EpochBoard> {
    // Scores that are told only after the epoch are released once it is settled: then none of them changes any more.
    let is_released =
        epoch.settled_at_ms.is_some() || tier.feedback(epoch.commitment.dev_feedback) > Feedback::AfterEpoch;
    let entries: Vec<EntryRow> =
        state.store.entries(epoch.id()).await?.into_iter().filter(|entry| entry.tier == tier).collect();
    let registered = entries.len();
    let mut rows = Vec::new();
    if is_released {
        let mut of_entry: BTreeMap<String, Vec<Answered>> = BTreeMap::new();
        for outcome in state.store.board_outcomes(epoch.id(), tier).await? {
            let BoardOutcome { entry_id, salt, passes, is_answered, has_transcript, is_checked } = outcome;
            let answered = Answered { salt, passes, is_answered, has_transcript, is_checked };
            of_entry.entry(entry_id).or_default().push(answered);
        }
        let entrants = entries.into_iter().map(|entry| Entrant {
            instances: of_entry.remove(&entry.id).unwrap_or_default(),
            id: entry.id,
            owner: entry.owner,
            agent: entry.agent,
            configuration_sha256: entry.configuration_hash,
            runs: entry.runs,
            completed_at_ms: entry.completed_at_ms,
        });
        rows = board::rows(tier, epoch.commitment.instances_per_run, entrants.collect());
    }
    Ok(EpochBoard { epoch: epoch.id().to_owned(), tier, is_released, registered, rows })
}

/// Returns the board of one tier of an epoch. The official board pools all entries of an owner, counts unanswered
/// instances as failed, and is released after the epoch has closed. The Ladder updates the dev board.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/leaderboard", operation_id = "get_epoch_leaderboard", tag = "hidden evaluation",
    summary = "Get an epoch's board",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11"), EpochBoardQuery),
    responses(
        (status = 200, description = "The board", body = EpochBoard,
         example = json!({ "epoch": "2026-11", "tier": "official", "is_released": false, "registered": 3, "rows": [] })),
    )
)]
pub async fn get_epoch_leaderboard(
    State(state): State<AppState>,
    Path(epoch): Path<String>,
    Params(query): Params<EpochBoardQuery>,
) -> AppResult<Json<EpochBoard>> {
    let epoch = stored_epoch(&state, &epoch).await?;
    let mut board = board_of(&state, &epoch, query.tier.unwrap_or(Tier::Official)).await?;
    if let Some(wanted) = &query.provenance {
        board.rows.retain(|row| &row.provenance == wanted);
    }
    Ok(Json(board))
}
