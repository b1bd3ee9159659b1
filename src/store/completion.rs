//! Completion of entries: what an entry releases is settled once, when all its answers are graded.

use super::db::{Tx, query, query_as};
use super::entries::{EntryRow, entry_in};
use super::epochs::{EpochRow, close_in, epoch_in};
use super::evidence::witness;
use super::locks::Lock;
use super::padding::publish_due;
use super::{Store, StoreError, StoreResult, commit, quota};
use plumbline_engine::hidden::evidence::{CompletedFact, Fact};
use plumbline_engine::hidden::receipts::Signer;

/// Stored facts that decide whether an entry is complete.
#[derive(Debug, Clone)]
pub struct CompletionFacts {
    /// The entry.
    pub entry: EntryRow,
    /// Epoch of the entry, with the bits that it has released so far.
    pub epoch: EpochRow,
    /// Number of answered instances.
    pub answered: usize,
    /// Number of answers that have neither a grade nor failed on our side.
    pub waiting: i64,
    /// Number of answers whose grading failed on our side.
    pub failed: i64,
    /// Time of the decision, in milliseconds since 1970.
    pub now_ms: i64,
}

/// Consequences of completing an entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Completion {
    /// Bits that the entry's result releases.
    pub released_bits: f64,
    /// Published reason for closing the epoch now; none if it stays open.
    pub closes_epoch: Option<&'static str>,
}

/// Decides from stored facts whether an entry is complete, and what follows from it; the use cases own the rule.
pub type DecideCompletion = fn(&CompletionFacts) -> Option<Completion>;

/// Reads the facts that decide whether an entry is complete.
async fn facts_of(tx: &mut Tx, entry_id: &str, now_ms: i64) -> StoreResult<CompletionFacts> {
    let entry = entry_in(tx, entry_id).await?.ok_or_else(|| StoreError::corrupt("entries", "gone"))?;
    let epoch = epoch_in(tx, &entry.epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    let (answered, waiting, failed): (i64, i64, i64) = query_as(
        "SELECT COUNT(*), COUNT(*) FILTER (WHERE s.state NOT IN ('graded', 'grader_error')),
                COUNT(*) FILTER (WHERE s.state = 'grader_error')
         FROM instances i JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE WHERE i.entry_id = $1",
    )
    .bind(entry_id)
    .fetch_one(tx)
    .await?;
    Ok(CompletionFacts { entry, epoch, answered: answered as usize, waiting, failed, now_ms })
}

/// Completes an entry if `decide` allows it: settles its quota, counts the bits released to its owner, and closes the
/// epoch if that was decided.
pub(super) async fn complete(
    tx: &mut Tx,
    signer: &Signer,
    entry_id: &str,
    decide: DecideCompletion,
    now_ms: i64,
) -> StoreResult<()> {
    let facts = facts_of(tx, entry_id, now_ms).await?;
    let Some(Completion { released_bits, closes_epoch }) = decide(&facts) else { return Ok(()) };
    let CompletionFacts { entry, epoch, .. } = facts;
    let finalized_at_ms =
        entry.finalized_at_ms.ok_or_else(|| StoreError::corrupt("entries", "complete, not finalized"))?;
    // A clock that is behind completes no entry before its end, nor before the end of an epoch that is closed: what is
    // told before that end counts against the epoch's budget.
    let closed_at_ms = epoch.closed.as_ref().map_or(now_ms, |(closed_at_ms, _)| *closed_at_ms);
    let now_ms = now_ms.max(finalized_at_ms).max(closed_at_ms);
    query("UPDATE entries SET completed_at_ms = $2 WHERE id = $1")
        .bind(entry_id)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
    settle_quota(tx, entry_id, now_ms).await?;
    let completed = CompletedFact { entry: entry_id.to_owned(), finalized_at_ms, completed_at_ms: now_ms };
    witness(tx, signer, epoch.id(), &Fact::Completed(completed)).await?;
    query("UPDATE epochs SET released_bits = released_bits + $2 WHERE id = $1")
        .bind(epoch.id())
        .bind(released_bits)
        .execute(&mut *tx)
        .await?;
    if let Some(reason) = closes_epoch {
        close_in(tx, epoch.id(), reason, now_ms).await?;
    }
    Ok(())
}

/// Charges the graded answers of an entry and refunds the others. This happens only when the entry is completed, so
/// that the ledger does not reveal when an answer was graded, or how.
async fn settle_quota(tx: &mut Tx, entry_id: &str, now_ms: i64) -> StoreResult<()> {
    let rows: Vec<(String, String, bool)> = query_as(
        "SELECT s.id, s.owner, s.state = 'graded'
         FROM submissions s JOIN instances i ON i.id = s.instance_id
         WHERE i.entry_id = $1 AND s.owner IS NOT NULL AND s.superseded = FALSE ORDER BY s.id",
    )
    .bind(entry_id)
    .fetch_all(&mut *tx)
    .await?;
    let charged: Vec<(&str, &str)> =
        rows.iter().filter(|(_, _, graded)| *graded).map(|(id, owner, _)| (owner.as_str(), id.as_str())).collect();
    quota::charge(tx, &charged, now_ms).await?;
    for (id, owner, _) in rows.iter().filter(|(_, _, graded)| !graded) {
        quota::refund(tx, owner, id, "not graded", now_ms).await?;
    }
    Ok(())
}

impl Store {
    /// Completes the finalized entries for which `decide` allows it, and publishes the pending receipts in the log, in
    /// one transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn publish_hidden(&self, decide: DecideCompletion, now_ms: i64) -> StoreResult<()> {
        const WAITING: &str = "SELECT id, epoch_id, owner FROM entries
                               WHERE finalized_at_ms IS NOT NULL AND completed_at_ms IS NULL ORDER BY id";
        let waiting: Vec<(String, String, String)> = query_as(WAITING).fetch_all(&self.readers).await?;
        if waiting.is_empty() && !self.has_pending_receipts().await? {
            return Ok(());
        }
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        tx.lock(waiting.iter().flat_map(|(_, epoch, owner)| [Lock::Epoch(epoch), Lock::Owner(owner)])).await?;
        for (entry, _, _) in &waiting {
            complete(&mut tx, &signer, entry, decide, now_ms).await?;
        }
        publish_due(&mut tx, &signer).await?;
        commit(tx, "publish_hidden").await
    }
}
