//! Completion of entries and settling of epochs, which happen in the background, and the rule that decides on them.

use super::budget::{BUDGET_SPENT, bits_of, is_spent_by};
use crate::store::completion::{Completion, CompletionFacts};
use crate::store::epochs::EpochRow;
use crate::store::{Store, StoreResult};

/// Decides whether an entry is complete: finalized, with all answers graded. Closes the epoch if its budget of released
/// information is spent.
#[must_use]
pub fn decide_completion(facts: &CompletionFacts) -> Option<Completion> {
    let CompletionFacts { entry, epoch, answered, waiting, failed, now_ms } = facts;
    // An answer whose grading failed on our side may be given again until the epoch is over; after that it counts as
    // failed.
    let is_graded = *waiting == 0 && (*failed == 0 || epoch.is_over(*now_ms));
    if entry.finalized_at_ms.is_none() || entry.completed_at_ms.is_some() || !is_graded {
        return None;
    }
    let released_bits = bits_of(epoch, entry.tier, *answered);
    Some(Completion { released_bits, closes_epoch: is_spent_by(epoch, released_bits).then_some(BUDGET_SPENT) })
}

/// Returns whether an epoch is to be settled: it is over, and was not settled before.
fn is_due(epoch: &EpochRow, now_ms: i64) -> bool {
    epoch.settled_at_ms.is_none() && epoch.is_over(now_ms)
}

/// Completes the finalized entries whose answers are all graded, and publishes the pending receipts.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn publish(store: &Store, now_ms: i64) -> StoreResult<()> {
    store.publish_hidden(decide_completion, now_ms).await
}

/// Settles all epochs that are over and not settled: finalizes their open entries, and counts instances as failed if
/// they have no answer or if their grading failed because of us.
///
/// # Errors
/// Returns an error if the epochs cannot be read.
pub async fn settle_epochs(store: &Store, now_ms: i64) -> StoreResult<()> {
    for epoch in store.epochs().await?.iter().filter(|epoch| is_due(epoch, now_ms)) {
        // A damaged epoch must not keep the others from being settled.
        if let Err(error) = store.settle_epoch(epoch.id(), decide_completion, now_ms).await {
            tracing::error!(%error, epoch = epoch.id(), "could not settle an epoch that is over");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::{CLOSES_AT_MS, OPENS_AT_MS, entry, epoch};
    use plumbline_engine::hidden::feedback::Tier;

    fn facts() -> CompletionFacts {
        let mut entry = entry("own", "a", Tier::Dev);
        entry.finalized_at_ms = Some(OPENS_AT_MS);
        CompletionFacts { entry, epoch: epoch(), answered: 3, waiting: 0, failed: 0, now_ms: OPENS_AT_MS }
    }

    #[test]
    fn an_entry_is_complete_once_it_is_finalized_and_graded() {
        for (is_finalized, is_completed, waiting, failed, now_ms, is_complete) in [
            (true, false, 0, 0, OPENS_AT_MS, true),
            (false, false, 0, 0, OPENS_AT_MS, false),
            (true, true, 0, 0, OPENS_AT_MS, false),
            (true, false, 1, 0, OPENS_AT_MS, false),
            (true, false, 1, 0, CLOSES_AT_MS, false),
            // A failure of ours may be answered again until the epoch is over.
            (true, false, 0, 1, CLOSES_AT_MS - 1, false),
            (true, false, 0, 1, CLOSES_AT_MS, true),
            (true, false, 1, 1, CLOSES_AT_MS, false),
        ] {
            let mut facts = CompletionFacts { waiting, failed, now_ms, ..facts() };
            facts.entry.finalized_at_ms = is_finalized.then_some(OPENS_AT_MS);
            facts.entry.completed_at_ms = is_completed.then_some(OPENS_AT_MS);
            let case = format!("{is_finalized} {is_completed} {waiting} {failed} {now_ms}");
            assert_eq!(decide_completion(&facts).is_some(), is_complete, "{case}");
        }
    }

    #[test]
    fn a_complete_entry_releases_bits_and_the_last_of_the_budget_close_the_epoch() {
        let bits = bits_of(&epoch(), Tier::Dev, 3);
        for (tier, before, released_bits, closes_epoch) in [
            (Tier::Dev, 0.0, bits, None),
            (Tier::Dev, 10.0 - bits, bits, Some(BUDGET_SPENT)),
            (Tier::Official, 10.0, 0.0, None),
        ] {
            let mut facts = facts();
            (facts.entry.tier, facts.epoch.released_bits) = (tier, before);
            assert_eq!(
                decide_completion(&facts),
                Some(Completion { released_bits, closes_epoch }),
                "{tier:?} {before}"
            );
        }
    }

    #[test]
    fn an_epoch_is_settled_once_after_its_end() {
        for (closed, settled, now_ms, expected) in [
            (false, false, CLOSES_AT_MS - 1, false),
            (false, false, CLOSES_AT_MS, true),
            (true, false, OPENS_AT_MS, true),
            (true, true, CLOSES_AT_MS, false),
        ] {
            let closed_at = closed.then(|| (OPENS_AT_MS, BUDGET_SPENT.to_owned()));
            let epoch = EpochRow { closed: closed_at, settled_at_ms: settled.then_some(OPENS_AT_MS), ..epoch() };
            assert_eq!(is_due(&epoch, now_ms), expected, "{closed} {settled} {now_ms}");
        }
    }
}
