//! Settling of epochs that are over: closes the epoch for good, completes its entries, publishes its receipts, and
//! marks it settled.

use super::completion::{DecideCompletion, complete};
use super::db::{Tx, query, query_scalar};
use super::epochs::{epoch_in, seal_in};
use super::evidence::{count_of, witness};
use super::locks::Lock;
use super::order_of_steps::{StepsOf, not_before};
use super::pending::publish;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{ClosedFact, Fact};
use plumbline_engine::hidden::receipts::Signer;

impl Store {
    /// Settles an epoch, which callers must know to be over: closes it for good, finalizes open entries, completes
    /// those for which `decide` allows it, and marks the epoch settled once all entries are complete and all receipts
    /// published.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn settle_epoch(&self, id: &str, decide: DecideCompletion, now_ms: i64) -> StoreResult<()> {
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        tx.lock([Lock::Epoch(id)]).await?;
        let owners: Vec<String> =
            query_scalar("SELECT DISTINCT owner FROM entries WHERE epoch_id = $1").bind(id).fetch_all(&mut tx).await?;
        tx.lock(owners.iter().map(|owner| Lock::Owner(owner))).await?;
        seal_in(&mut tx, id).await?;
        settle_in(&mut tx, &signer, id, decide, now_ms).await?;
        commit(tx, "settle_epoch").await
    }
}

async fn settle_in(
    tx: &mut Tx,
    signer: &Signer,
    epoch_id: &str,
    decide: DecideCompletion,
    now_ms: i64,
) -> StoreResult<()> {
    let open: Vec<String> =
        query_scalar("SELECT id FROM entries WHERE epoch_id = $1 AND completed_at_ms IS NULL ORDER BY id")
            .bind(epoch_id)
            .fetch_all(&mut *tx)
            .await?;
    for entry in &open {
        query("UPDATE entries SET finalized_at_ms = $2 WHERE id = $1 AND finalized_at_ms IS NULL")
            .bind(entry)
            .bind(not_before(tx, StepsOf::Entry(entry), now_ms).await?)
            .execute(&mut *tx)
            .await?;
        complete(tx, signer, entry, decide, now_ms).await?;
    }
    let is_open: bool =
        query_scalar("SELECT EXISTS (SELECT 1 FROM entries WHERE epoch_id = $1 AND completed_at_ms IS NULL)")
            .bind(epoch_id)
            .fetch_one(&mut *tx)
            .await?;
    let epoch = epoch_in(tx, epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    if is_open || epoch.settled_at_ms.is_some() {
        return Ok(());
    }
    let (closed_at_ms, reason) = epoch.closed.ok_or_else(|| StoreError::corrupt("epochs", "over, not closed"))?;
    // Publish the others first: within a batch receipts are ordered by hash, and this one must be the last.
    publish(tx, Some(epoch_id)).await?;
    let receipts = count_of(tx, epoch_id).await?;
    witness(tx, signer, epoch_id, &Fact::Closed(ClosedFact { closed_at_ms, reason, receipts })).await?;
    publish(tx, Some(epoch_id)).await?;
    query("UPDATE epochs SET settled_at_ms = $2 WHERE id = $1").bind(epoch_id).bind(now_ms).execute(tx).await?;
    Ok(())
}
