//! Evidence of hidden evaluation: receipts that are signed in the same transaction as the fact they state, and
//! published later.

use serde_json::Value;

use super::db::{Tx, query, query_scalar};
use super::secrets::random_key;
use super::{Store, StoreError, StoreResult};
use plumbline_engine::hidden::evidence::{Fact, GivenReceipt, receipt};
use plumbline_engine::hidden::receipts::{Signed, Signer};
use plumbline_engine::tasks::hex;

/// Signs a fact and stores its receipt for later publication.
pub(super) async fn witness(tx: &mut Tx, signer: &Signer, epoch_id: &str, fact: &Fact) -> StoreResult<GivenReceipt> {
    let receipt: Value = receipt(epoch_id, &random_key()?, fact);
    let signed = signer.sign(&receipt);
    keep(tx, epoch_id, None, &signed).await?;
    Ok(GivenReceipt::of(receipt, &signed))
}

/// Stores a receipt of an epoch for later publication; `of` is the submission and attempt of a grade.
pub(super) async fn keep(tx: &mut Tx, epoch_id: &str, of: Option<(&str, i64)>, signed: &Signed) -> StoreResult<()> {
    query(
        "INSERT INTO pending_receipts (epoch_id, submission_id, attempt, body, hash, signature, public_key)
         VALUES ($1, $2, $3, $4, $5, $6, $7)",
    )
    .bind(epoch_id)
    .bind(of.map(|(submission, _)| submission))
    .bind(of.map(|(_, attempt)| attempt))
    .bind(&signed.body)
    .bind(hex(&signed.hash))
    .bind(&signed.signature)
    .bind(&signed.public_key)
    .execute(tx)
    .await?;
    Ok(())
}

/// Counts the receipts of an epoch, published or pending.
pub(super) async fn count_of(tx: &mut Tx, epoch_id: &str) -> StoreResult<u64> {
    let count: i64 = query_scalar(
        "SELECT (SELECT COUNT(*) FROM receipts WHERE epoch_id = $1) + (SELECT COUNT(*) FROM pending_receipts WHERE epoch_id = $1)",
    )
    .bind(epoch_id)
    .fetch_one(tx)
    .await?;
    u64::try_from(count).map_err(|error| StoreError::corrupt("receipts", error))
}

impl Store {
    /// Returns whether receipts are pending.
    pub(super) async fn has_pending_receipts(&self) -> StoreResult<bool> {
        const WAITING: &str = "SELECT EXISTS (SELECT 1 FROM pending_receipts)";
        query_scalar(WAITING).fetch_one(&self.readers).await
    }
}
