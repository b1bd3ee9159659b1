//! Settling of epochs that are over: closes the epoch for good, completes its entries, publishes its receipts, and
//! marks it settled.

use super::db::{Tx, query, query_scalar};
use super::entries::complete_if_graded;
use super::epochs::{EpochRow, epoch_in, seal_in};
use super::evidence::{count_of, publish, witness};
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{ClosedFact, Fact};
use plumbline_engine::hidden::receipts::Signer;

impl Store {
    /// Settles an epoch that is over: finalizes open entries, and counts instances as failed if they have no answer or
    /// if their grading failed because of us. Returns whether all answers are graded and all receipts published.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn settle_epoch(&self, epoch: &EpochRow, now_ms: i64) -> StoreResult<bool> {
        if epoch.settled_at_ms.is_some() {
            return Ok(true);
        }
        if !epoch.is_over(now_ms) {
            return Ok(false);
        }
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        seal_in(&mut tx, epoch.id()).await?;
        let is_settled = settle_in(&mut tx, &signer, epoch.id(), now_ms).await?;
        commit(tx, "settle_epoch").await?;
        Ok(is_settled)
    }

    /// Settles all epochs that are over and not settled.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn settle_epochs(&self, now_ms: i64) -> StoreResult<()> {
        for epoch in self.epochs().await? {
            // A damaged epoch must not keep the others from being settled.
            if let Err(error) = self.settle_epoch(&epoch, now_ms).await {
                tracing::error!(%error, epoch = epoch.id(), "could not settle an epoch that is over");
            }
        }
        Ok(())
    }
}

async fn settle_in(tx: &mut Tx, signer: &Signer, epoch_id: &str, now_ms: i64) -> StoreResult<bool> {
    let open: Vec<String> =
        query_scalar("SELECT id FROM entries WHERE epoch_id = $1 AND completed_at_ms IS NULL ORDER BY id")
            .bind(epoch_id)
            .fetch_all(&mut *tx)
            .await?;
    for entry in &open {
        query("UPDATE entries SET finalized_at_ms = $2 WHERE id = $1 AND finalized_at_ms IS NULL")
            .bind(entry)
            .bind(now_ms)
            .execute(&mut *tx)
            .await?;
        complete_if_graded(tx, signer, entry, now_ms).await?;
    }
    let is_open: bool =
        query_scalar("SELECT EXISTS (SELECT 1 FROM entries WHERE epoch_id = $1 AND completed_at_ms IS NULL)")
            .bind(epoch_id)
            .fetch_one(&mut *tx)
            .await?;
    let epoch = epoch_in(tx, epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    if is_open || epoch.settled_at_ms.is_some() {
        return Ok(!is_open);
    }
    let (closed_at_ms, reason) = epoch.closed.ok_or_else(|| StoreError::corrupt("epochs", "over, not closed"))?;
    // Publish the others first: within a batch receipts are ordered by hash, and this one must be the last.
    publish(tx, Some(epoch_id)).await?;
    let receipts = count_of(tx, epoch_id).await?;
    witness(tx, signer, epoch_id, &Fact::Closed(ClosedFact { closed_at_ms, reason, receipts })).await?;
    publish(tx, Some(epoch_id)).await?;
    query("UPDATE epochs SET settled_at_ms = $2 WHERE id = $1").bind(epoch_id).bind(now_ms).execute(tx).await?;
    Ok(true)
}
