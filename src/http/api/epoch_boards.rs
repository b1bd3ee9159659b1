//! Boards of epochs: the dev board that the Ladder keeps, and the official one.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use super::super::params::Params;
use super::super::problem::{ApiResult, Problem};
use super::super::state::AppState;
use super::epochs::stored_epoch;
use crate::clock::now_ms;
use crate::epochs::feedback::{Feedback, Tier};
use crate::epochs::ladder::{Attempt, Tally, climb};
use crate::grading::statistics::interval::{Interval, wilson};
use crate::store::entries::{BoardOutcome, EntryRow};
use crate::store::epochs::EpochRow;

/// Which board.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EpochBoardQuery {
    /// `official` or `dev`.
    tier: Option<Tier>,
    /// Only rows of this provenance.
    provenance: Option<String>,
}

/// A row: an owner's official entries taken together, or where the Ladder has an owner.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpochRowBody {
    /// Place; a row whose interval reaches the score of the first row of a place shares that place.
    pub rank: usize,
    /// Who registered.
    pub owner: String,
    /// Who was evaluated.
    pub agent: String,
    /// SHA-256 of its configuration.
    pub configuration_sha256: String,
    /// Share of instances that pass.
    pub overall: f64,
    /// Wilson interval of that share, 95 %.
    pub interval: Option<Interval>,
    /// Instances that pass.
    pub passed: u32,
    /// Instances that count.
    pub of: u32,
    /// Entries that the owner registered in this tier, finalized or not.
    pub attempts: usize,
    /// `nonce-bound` at least; `transcript-committed` where every answer promised its transcript.
    pub provenance: &'static str,
    /// Transcripts that were shown and were those promised.
    pub transcripts_checked: usize,
    /// The entries behind the row.
    pub entries: Vec<String>,
}

/// A board of an epoch.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpochBoard {
    /// The epoch.
    pub epoch: String,
    /// The tier.
    pub tier: Tier,
    /// Whether scores are told: of the official tier after the epoch has closed.
    pub is_released: bool,
    /// Entries registered in this tier.
    pub registered: usize,
    /// The rows, best first; empty while scores are not told.
    pub rows: Vec<EpochRowBody>,
}

/// An entry with what its instances came to.
struct Own {
    entry: EntryRow,
    outcomes: Vec<BoardOutcome>,
}

impl Own {
    /// Instances of the entry, those of runs that were never drawn too.
    const fn instances(&self, epoch: &EpochRow) -> u32 {
        self.entry.runs as u32 * epoch.commitment.instances_per_run
    }

    fn has_transcripts(&self) -> bool {
        let mut answered = self.outcomes.iter().filter(|outcome| outcome.is_answered).peekable();
        answered.peek().is_some() && answered.all(|outcome| outcome.has_transcript)
    }

    /// The entry as the Ladder sees it. What was not drawn failed, in equal parts of what decides and what is shown.
    fn attempt(&self, epoch: &EpochRow) -> Attempt<'_> {
        let outcomes = self.outcomes.iter().map(|outcome| (outcome.salt.as_str(), outcome.passes));
        let mut attempt = Attempt::of(&self.entry.configuration_hash, outcomes);
        let undrawn = self.instances(epoch).saturating_sub(self.outcomes.len() as u32);
        attempt.deciding.of += undrawn.div_ceil(2);
        attempt.shown.of += undrawn / 2;
        attempt
    }
}

/// The row of an owner's complete entries, in the order in which they ended.
fn row(epoch: &EpochRow, tier: Tier, own: &[Own], attempts: usize) -> Option<EpochRowBody> {
    let first = own.first()?;
    let (shown, named) = match tier {
        Tier::Official => {
            let passed = own.iter().flat_map(|own| &own.outcomes).filter(|outcome| outcome.passes).count() as u32;
            (Tally { passed, of: own.iter().map(|own| own.instances(epoch)).sum() }, first)
        }
        Tier::Dev => {
            let attempts: Vec<Attempt<'_>> = own.iter().map(|own| own.attempt(epoch)).collect();
            let rung = climb(&attempts)?;
            (rung.shown, own.get(rung.attempt)?)
        }
    };
    Some(EpochRowBody {
        rank: 0,
        owner: first.entry.owner.clone(),
        agent: named.entry.agent.clone(),
        configuration_sha256: named.entry.configuration_hash.clone(),
        overall: shown.rate(),
        interval: wilson(shown.rate(), f64::from(shown.of)),
        passed: shown.passed,
        of: shown.of,
        attempts,
        provenance: if own.iter().all(Own::has_transcripts) { "transcript-committed" } else { "nonce-bound" },
        transcripts_checked: own.iter().flat_map(|own| &own.outcomes).filter(|outcome| outcome.is_checked).count(),
        entries: own.iter().map(|own| own.entry.id.clone()).collect(),
    })
}

/// The board of a tier.
///
/// # Errors
/// Where the database fails.
pub async fn board_of(state: &AppState, epoch: &EpochRow, tier: Tier) -> ApiResult<EpochBoard> {
    let now = now_ms();
    let is_released = epoch.is_over(now) || tier.feedback(epoch.commitment.dev_feedback) > Feedback::AfterEpoch;
    state.store.finalize_what_is_over(epoch, now).await?;
    let entries: Vec<EntryRow> =
        state.store.entries(epoch.id()).await?.into_iter().filter(|entry| entry.tier == tier).collect();
    let registered = entries.len();
    let mut by_owner: BTreeMap<String, (usize, Vec<Own>)> = BTreeMap::new();
    if is_released {
        let mut of_entry: BTreeMap<String, Vec<BoardOutcome>> = BTreeMap::new();
        for outcome in state.store.board_outcomes(epoch.id(), tier).await? {
            of_entry.entry(outcome.entry_id.clone()).or_default().push(outcome);
        }
        for entry in entries {
            let slot = by_owner.entry(entry.owner.clone()).or_default();
            slot.0 += 1;
            if entry.completed_at_ms.is_some() {
                let outcomes = of_entry.remove(&entry.id).unwrap_or_default();
                slot.1.push(Own { entry, outcomes });
            }
        }
    }
    let mut rows: Vec<EpochRowBody> = by_owner
        .into_values()
        .filter_map(|(attempts, mut own)| {
            own.sort_by(|a, b| (a.entry.completed_at_ms, &a.entry.id).cmp(&(b.entry.completed_at_ms, &b.entry.id)));
            row(epoch, tier, &own, attempts)
        })
        .collect();
    rows.sort_by(|a, b| b.overall.total_cmp(&a.overall).then_with(|| a.owner.cmp(&b.owner)));
    for i in 0..rows.len() {
        let ties = i > 0 && rows[i].interval.is_some_and(|own| own.high >= rows[rows[i - 1].rank - 1].overall);
        rows[i].rank = if ties { rows[i - 1].rank } else { i + 1 };
    }
    Ok(EpochBoard { epoch: epoch.id().to_owned(), tier, is_released, registered, rows })
}

/// A board of an epoch. The official one takes all entries of an owner together, unanswered instances failed, and is told after
/// the epoch has closed; the dev one moves by the Ladder.
#[utoipa::path(
    get, path = "/v1/epochs/{epoch}/leaderboard", operation_id = "get_epoch_leaderboard", tag = "hidden evaluation",
    summary = "Read an epoch's board",
    params(("epoch" = String, Path, description = "The epoch's name", example = "2026-11"), EpochBoardQuery),
    responses(
        (status = 200, description = "The board", body = EpochBoard,
         example = json!({ "epoch": "2026-11", "tier": "official", "is_released": false, "registered": 3, "rows": [] })),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is none of this name", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_epoch_leaderboard(
    State(state): State<AppState>,
    Path(epoch): Path<String>,
    Params(query): Params<EpochBoardQuery>,
) -> ApiResult<Json<EpochBoard>> {
    let epoch = stored_epoch(&state, &epoch).await?;
    let mut board = board_of(&state, &epoch, query.tier.unwrap_or(Tier::Official)).await?;
    if let Some(wanted) = &query.provenance {
        board.rows.retain(|row| row.provenance == wanted);
    }
    Ok(Json(board))
}
