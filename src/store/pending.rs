//! Receipts of hidden evaluation that are signed and wait for their publication in the log.

use super::db::{Tx, query_as};
use super::locks::Lock;
use super::receipts::{NewReceipt, enter};
use super::rows::from_row;
use super::{StoreError, StoreResult};
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::receipts::Signed;

/// Number of receipts that one statement inserts.
const AT_ONCE: usize = 500;

/// A receipt that waits for its publication.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pending {
    pub epoch_id: String,
    pub submission_id: Option<String>,
    pub attempt: Option<i64>,
    pub body: String,
    pub hash: String,
    pub signature: String,
    pub public_key: String,
}

from_row!(Pending { epoch_id, submission_id, attempt, body, hash, signature, public_key });

impl Pending {
    pub fn signed(&self) -> StoreResult<Signed> {
        let hash = unhex(&self.hash).ok_or_else(|| StoreError::corrupt("pending_receipts", "hash"))?;
        let (body, signature, public_key) = (self.body.clone(), self.signature.clone(), self.public_key.clone());
        Ok(Signed { body, hash, signature, public_key })
    }

    pub const fn of(&self) -> Option<(&str, i64)> {
        match (&self.submission_id, self.attempt) {
            (Some(submission), Some(attempt)) => Some((submission.as_str(), attempt)),
            _ => None,
        }
    }
}

/// Takes all pending receipts of one epoch, or of all.
pub(super) async fn take(tx: &mut Tx, epoch_id: Option<&str>) -> StoreResult<Vec<Pending>> {
    // What is deleted is what is published: another node may sign more meanwhile.
    query_as(
        "DELETE FROM pending_receipts WHERE $1 IS NULL OR epoch_id = $1
         RETURNING epoch_id, submission_id, attempt, body, hash, signature, public_key",
    )
    .bind(epoch_id)
    .fetch_all(tx)
    .await
}

/// The statement that deletes the pending receipts of an epoch that a condition selects, and returns them.
macro_rules! taking {
    ($which:literal) => {
        concat!(
            "DELETE FROM pending_receipts WHERE epoch_id = $1 AND ",
            $which,
            " RETURNING epoch_id, submission_id, attempt, body, hash, signature, public_key"
        )
    };
}

/// Takes the pending receipts of an epoch that are neither grades nor failures. Within a text of canonical JSON a
/// quotation mark has a backslash before it, so the pattern matches nothing else.
pub(super) async fn take_others(tx: &mut Tx, epoch_id: &str) -> StoreResult<Vec<Pending>> {
    query_as(taking!("submission_id IS NULL AND body NOT LIKE '%\"failure\":{%'")).bind(epoch_id).fetch_all(tx).await
}

/// Takes the pending grades of an entry.
pub(super) async fn take_grades_of(tx: &mut Tx, epoch_id: &str, entry_id: &str) -> StoreResult<Vec<Pending>> {
    query_as(taking!(
        "submission_id IN (SELECT s.id FROM submissions s JOIN instances i ON i.id = s.instance_id WHERE i.entry_id = $2)"
    ))
    .bind(epoch_id)
    .bind(entry_id)
    .fetch_all(tx)
    .await
}

/// Takes at most `most` pending grades and failures of an epoch: failures first, grades in the order of their hashes,
/// which says nothing of their age.
pub(super) async fn take_grades(tx: &mut Tx, epoch_id: &str, most: usize) -> StoreResult<Vec<Pending>> {
    query_as(taking!(
        "id IN (SELECT id FROM pending_receipts
                WHERE epoch_id = $1 AND (submission_id IS NOT NULL OR body LIKE '%\"failure\":{%')
                ORDER BY submission_id IS NOT NULL, hash LIMIT $2)"
    ))
    .bind(epoch_id)
    .bind(most as i64)
    .fetch_all(tx)
    .await
}

/// Publishes all pending receipts of one epoch, or of all, in the log.
pub(super) async fn publish(tx: &mut Tx, epoch_id: Option<&str>) -> StoreResult<()> {
    // Before any row is deleted: other transactions hold this lock when they delete pending receipts.
    tx.lock([Lock::Order]).await?;
    let pending = take(tx, epoch_id).await?;
    enter_all(tx, pending).await
}

/// Enters receipts in the log. They are ordered by hash, so that the order reveals nothing, but completions of entries
/// come last: the grades of an entry stand before its completion.
pub(super) async fn enter_all(tx: &mut Tx, mut pending: Vec<Pending>) -> StoreResult<()> {
    let is_completion = |own: &Pending| own.body.starts_with("{\"completed\":{");
    pending.sort_by_cached_key(|own| (is_completion(own), own.hash.clone()));
    let signed = pending.iter().map(Pending::signed).collect::<StoreResult<Vec<Signed>>>()?;
    let new: Vec<NewReceipt<'_>> = pending
        .iter()
        .zip(&signed)
        .map(|(row, signed)| NewReceipt { of: row.of(), epoch_id: Some(&row.epoch_id), signed })
        .collect();
    for part in new.chunks(AT_ONCE) {
        enter(tx, part).await?;
    }
    Ok(())
}
