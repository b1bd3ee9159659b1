//! Boards of epochs: the dev board, kept by the Ladder, and the official board.

use std::collections::BTreeMap;

use super::epochs::stored_epoch;
use crate::app::App;
use crate::app::error::AppResult;
use crate::store::entries::{BoardOutcome, EntryRow};
use crate::store::epochs::EpochRow;
use plumbline_engine::hidden::board;
use plumbline_engine::hidden::board::{Answered, BoardRules, Entrant, Row};
use plumbline_engine::hidden::feedback::{Feedback, Tier};

/// The board of one tier of an epoch.
#[derive(Debug)]
pub struct TierBoard {
    /// Name of the epoch.
    pub epoch: String,
    /// Tier of the board.
    pub tier: Tier,
    /// Whether scores are released.
    pub is_released: bool,
    /// Whether the rows are final; none in epochs of the first protocol, which do not tell.
    pub is_final: Option<bool>,
    /// Number of entries registered in this tier.
    pub registered: usize,
    /// Rows, best first; empty until scores are released.
    pub rows: Vec<Row>,
}

/// Returns the board of one tier of the epoch with this name; if a provenance is given, only rows with it.
///
/// # Errors
/// Returns an error (404) if no epoch has this name.
pub async fn tier_board(app: &App, epoch: &str, tier: Tier, provenance: Option<&str>) -> AppResult<TierBoard> {
    let epoch = stored_epoch(app, epoch).await?;
    let mut board = board_of(app, &epoch, tier).await?;
    board.rows.retain(|row| provenance.is_none_or(|wanted| row.provenance == wanted));
    Ok(board)
}

/// Returns the board of one tier of an epoch.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn board_of(app: &App, epoch: &EpochRow, tier: Tier) -> AppResult<TierBoard> {
    let is_released = is_released(epoch, tier);
    let entries: Vec<EntryRow> =
        app.store.entries(epoch.id()).await?.into_iter().filter(|entry| entry.tier == tier).collect();
    let registered = entries.len();
    let mut rows = Vec::new();
    // Nobody could draw from a pool that was never made.
    let had_pool = epoch.commitment.beacon.is_none() || epoch.pool.is_some();
    if is_released && had_pool {
        rows = rows_of(epoch, tier, entries, app.store.board_outcomes(epoch.id(), tier).await?);
    }
    let is_final = (epoch.commitment.protocol() >= 2).then_some(epoch.settled_at_ms.is_some());
    Ok(TierBoard { epoch: epoch.id().to_owned(), tier, is_released, is_final, registered, rows })
}

/// Returns whether the scores of a tier are released. Scores that are told only after the epoch are released once it is
/// settled: then none of them changes any more.
fn is_released(epoch: &EpochRow, tier: Tier) -> bool {
    epoch.settled_at_ms.is_some() || tier.feedback(epoch.commitment.dev_feedback) > Feedback::AfterEpoch
}

fn rows_of(epoch: &EpochRow, tier: Tier, entries: Vec<EntryRow>, outcomes: Vec<BoardOutcome>) -> Vec<Row> {
    let mut of_entry: BTreeMap<String, Vec<Answered>> = BTreeMap::new();
    for outcome in outcomes {
        let BoardOutcome { entry_id, salt, family, run, leaf, passes, is_answered, has_transcript, is_checked } =
            outcome;
        let [run, leaf] = [run, leaf].map(|own| u32::try_from(own).expect("stored from a number of 32 bits"));
        let is_sibling = epoch.commitment.is_sibling(leaf);
        let answered = Answered { salt, family, run, is_sibling, passes, is_answered, has_transcript, is_checked };
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
    board::rows(&BoardRules::of(&epoch.commitment, tier, epoch.settled_at_ms.is_some()), entrants.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::{CLOSES_AT_MS, epoch};

    #[test]
    fn scores_told_after_the_epoch_are_released_when_it_is_settled() {
        for (tier, dev_feedback, is_settled, expected) in [
            (Tier::Official, Feedback::ScoreOnly, false, false),
            (Tier::Official, Feedback::ScoreOnly, true, true),
            (Tier::Dev, Feedback::ScoreOnly, false, true),
            (Tier::Dev, Feedback::AfterEpoch, false, false),
            (Tier::Dev, Feedback::AfterEpoch, true, true),
        ] {
            let mut epoch = epoch();
            epoch.commitment.dev_feedback = dev_feedback;
            epoch.settled_at_ms = is_settled.then_some(CLOSES_AT_MS);
            assert_eq!(is_released(&epoch, tier), expected, "{tier:?} {dev_feedback:?} {is_settled}");
        }
    }
}
