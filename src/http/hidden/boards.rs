//! Boards of epochs: the dev board, kept by the Ladder, and the official board.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use crate::app::error::AppResult;
use crate::app::hidden::boards::{TierBoard, tier_board};
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::hidden::board::Row;
use plumbline_engine::hidden::feedback::Tier;

/// Query of an epoch's board.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EpochBoardQuery {
    /// Tier of the board: `official` (the default) or `dev`.
    tier: Option<Tier>,
    /// Only rows with this provenance; `verify-epoch` needs the board without it.
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
    /// Whether the epoch is over and the rows no longer change. Absent for epochs of version 1 of the protocol.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is_final: Option<bool>,
    /// Number of entries registered in this tier.
    pub registered: usize,
    /// Provenance of the rows, if the request asked for one; rows with another are left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<String>,
    /// Rows, best first; empty until scores are released.
    pub rows: Vec<Row>,
}

impl From<TierBoard> for EpochBoard {
    fn from(TierBoard { epoch, tier, is_released, is_final, registered, rows }: TierBoard) -> Self {
        Self { epoch, tier, is_released, is_final, registered, provenance: None, rows }
    }
}

/// Returns the board of one tier of an epoch.
///
/// The official board pools all entries of an owner, counts unanswered instances as failed, and is released after the
/// epoch has closed. The Ladder updates the dev board.
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
    let tier = query.tier.unwrap_or(Tier::Official);
    let board = EpochBoard::from(tier_board(&state, &epoch, tier, query.provenance.as_deref()).await?);
    Ok(Json(EpochBoard { provenance: query.provenance, ..board }))
}
