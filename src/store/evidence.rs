//! Evidence of hidden evaluation: receipts that are signed in the same transaction as the fact they state, and
//! published later.

use serde_json::Value;

use super::db::{Tx, query, query_as, query_scalar};
use super::receipts::{NewReceipt, enter};
use super::rows::from_row;
use super::secrets::random_key;
use super::{Store, StoreError, StoreResult};
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::evidence::{Fact, GivenReceipt, receipt};
use plumbline_engine::hidden::receipts::{Signed, Signer};
use plumbline_engine::tasks::hex;

/// Number of receipts that one statement inserts.
const AT_ONCE: usize = 500;

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

struct Pending {
    epoch_id: String,
    submission_id: Option<String>,
    attempt: Option<i64>,
    body: String,
    hash: String,
    signature: String,
    public_key: String,
}

from_row!(Pending { epoch_id, submission_id, attempt, body, hash, signature, public_key });

/// Publishes the pending receipts of one epoch, or of all, in the log. They are ordered by hash, so that the order
/// reveals nothing.
pub(super) async fn publish(tx: &mut Tx, epoch_id: Option<&str>) -> StoreResult<()> {
    // What is deleted is what is published: another node may sign more meanwhile.
    let mut pending: Vec<Pending> = query_as(
        "DELETE FROM pending_receipts WHERE $1 IS NULL OR epoch_id = $1
         RETURNING epoch_id, submission_id, attempt, body, hash, signature, public_key",
    )
    .bind(epoch_id)
    .fetch_all(&mut *tx)
    .await?;
    pending.sort_by(|one, other| one.hash.cmp(&other.hash));
    let mut signed = Vec::with_capacity(pending.len());
    for row in &pending {
        let hash = unhex(&row.hash).ok_or_else(|| StoreError::corrupt("pending_receipts", "hash"))?;
        let (body, signature, public_key) = (row.body.clone(), row.signature.clone(), row.public_key.clone());
        signed.push(Signed { body, hash, signature, public_key });
    }
    let new: Vec<NewReceipt<'_>> = pending
        .iter()
        .zip(&signed)
        .map(|(row, signed)| NewReceipt {
            of: row.submission_id.as_deref().zip(row.attempt),
            epoch_id: Some(&row.epoch_id),
            signed,
        })
        .collect();
    for part in new.chunks(AT_ONCE) {
        enter(tx, part).await?;
    }
    Ok(())
}

impl Store {
    /// Returns whether receipts are pending.
    pub(super) async fn has_pending_receipts(&self) -> StoreResult<bool> {
        const WAITING: &str = "SELECT EXISTS (SELECT 1 FROM pending_receipts)";
        query_scalar(WAITING).fetch_one(&self.readers).await
    }
}
