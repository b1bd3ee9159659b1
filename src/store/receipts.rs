//! Receipts: signed by the grader, and linked to each other in the transaction that stores the report.

use super::db::{Builder, Row, Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::{Store, StoreError, StoreResult};
use plumbline_engine::hidden::announcements::{Announcement, receipt};
use plumbline_engine::hidden::canonical::{Hash, unhex};
use plumbline_engine::hidden::receipts::{FIRST_LINK, ReceiptFile, Signed, Signer, link};
use plumbline_engine::tasks::hex;

/// Receipt to append.
pub(super) struct NewReceipt<'a> {
    /// Submission, and the attempt that graded it; none for other receipts.
    pub of: Option<(&'a str, i64)>,
    pub epoch_id: Option<&'a str>,
    pub signed: &'a Signed,
}

/// Appends receipts to the log.
pub(super) async fn enter(tx: &mut Tx, receipts: &[NewReceipt<'_>]) -> StoreResult<()> {
    if receipts.is_empty() {
        return Ok(());
    }
    tx.lock([Lock::Order]).await?;
    let last: Option<(i64, String)> =
        query_as("SELECT seq, link FROM receipts ORDER BY seq DESC LIMIT 1").fetch_optional(&mut *tx).await?;
    let (mut seq, mut previous): (i64, Hash) = match last {
        None => (0, FIRST_LINK),
        Some((seq, link)) => {
            (seq, unhex(&link).ok_or_else(|| StoreError::corrupt("receipts", format!("link of {seq}")))?)
        }
    };
    let links: Vec<(i64, Hash, Hash)> = receipts
        .iter()
        .map(|receipt| {
            seq += 1;
            let next = link(&previous, &receipt.signed.hash);
            let before = std::mem::replace(&mut previous, next);
            (seq, before, next)
        })
        .collect();
    let mut query = Builder::new(
        "INSERT INTO receipts (seq, submission_id, attempt, epoch_id, body, hash, signature, public_key, previous, link) ",
    );
    query.push_values(receipts.iter().zip(&links), |row, (receipt, (seq, before, next))| {
        row.push_bind(*seq)
            .push_bind(receipt.of.map(|(submission_id, _)| submission_id.to_owned()))
            .push_bind(receipt.of.map(|(_, attempt)| attempt))
            .push_bind(receipt.epoch_id.map(str::to_owned))
            .push_bind(receipt.signed.body.clone())
            .push_bind(hex(&receipt.signed.hash))
            .push_bind(receipt.signed.signature.clone())
            .push_bind(receipt.signed.public_key.clone())
            .push_bind(hex(before))
            .push_bind(hex(next));
    });
    query.build().execute(tx).await?;
    Ok(())
}

/// Signs an announcement and appends it to the log.
pub(super) async fn announce(tx: &mut Tx, signer: &Signer, told: &Announcement) -> StoreResult<()> {
    let signed = signer.sign(&receipt(told));
    enter(tx, &[NewReceipt { of: None, epoch_id: None, signed: &signed }]).await
}

macro_rules! select_receipt {
    ($rest:literal) => {
        concat!(
            "SELECT r.seq, r.body, r.hash, r.signature, r.public_key, r.previous, r.link,
                    (e.id IS NULL OR e.closed_at_ms IS NOT NULL) AS is_released
             FROM receipts r LEFT JOIN epochs e ON e.id = r.epoch_id ",
            $rest
        )
    };
}

/// Selects all receipts, in the order of the log.
pub(super) const SELECT_ALL: &str = select_receipt!("ORDER BY r.seq");

/// Reads a receipt with all that it has, whether or not the public may see it.
pub(super) fn read_whole(row: &Row) -> StoreResult<ReceiptFile> {
    let body: &str = row.get("body")?;
    let receipt = serde_json::from_str(body).map_err(|error| StoreError::corrupt("receipts", error))?;
    Ok(ReceiptFile { receipt: Some(receipt), signature: Some(row.get("signature")?), ..read(row)? })
}

/// Reads a receipt as the public may see it now: body and signature of a hidden instance's receipt only once its epoch
/// is over.
fn read(row: &Row) -> StoreResult<ReceiptFile> {
    let is_released: bool = row.get("is_released")?;
    let body: &str = row.get("body")?;
    let receipt = serde_json::from_str(body).map_err(|error| StoreError::corrupt("receipts", error))?;
    let signature: String = row.get("signature")?;
    Ok(ReceiptFile {
        seq: row.get("seq")?,
        receipt: Some(receipt).filter(|_| is_released),
        hash: row.get("hash")?,
        signature: Some(signature).filter(|_| is_released),
        public_key: row.get("public_key")?,
        previous: row.get("previous")?,
        link: row.get("link")?,
        place_signature: None,
        inclusion: None,
    })
}

impl Store {
    /// Returns at most `limit` receipts after number `after` of the log.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn receipts(&self, after: i64, limit: i64) -> StoreResult<Vec<ReceiptFile>> {
        let rows = query(select_receipt!("WHERE r.seq > $1 ORDER BY r.seq LIMIT $2"))
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Returns the hashes of at most `limit` receipts after number `after` of the log, in order.
    ///
    /// # Errors
    /// Returns an error if the database fails, or a hash cannot be read or is out of order.
    pub async fn receipt_hashes(&self, after: i64, limit: i64) -> StoreResult<Vec<Hash>> {
        let rows: Vec<(i64, String)> = query_as("SELECT seq, hash FROM receipts WHERE seq > $1 ORDER BY seq LIMIT $2")
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        let read = |(expected, (seq, hash)): (i64, (i64, String))| {
            let is_next = expected == seq;
            unhex(&hash).filter(|_| is_next).ok_or_else(|| StoreError::corrupt("receipts", format!("hash of {seq}")))
        };
        (after + 1..).zip(rows).map(read).collect()
    }

    /// Returns the number of receipts, and the position of the last one: the same number, if none is missing.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn log_extent(&self) -> StoreResult<(i64, i64)> {
        query_as("SELECT COUNT(*), COALESCE(MAX(seq), 0) FROM receipts").fetch_one(&self.readers).await
    }

    /// Returns the public key that the first receipt was signed with; none if there is no receipt.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn first_receipt_key(&self) -> StoreResult<Option<String>> {
        query_scalar("SELECT public_key FROM receipts WHERE seq = 1").fetch_optional(&self.readers).await
    }

    /// Returns the length of the log and its last link.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn log_end(&self) -> StoreResult<(i64, String)> {
        let last: Option<(i64, String)> =
            query_as("SELECT seq, link FROM receipts ORDER BY seq DESC LIMIT 1").fetch_optional(&self.readers).await?;
        Ok(last.unwrap_or_else(|| (0, hex(&FIRST_LINK))))
    }

    /// Returns the receipts of an epoch, in the order of the log. Callers must have checked that the epoch is over.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn receipts_of_epoch(&self, epoch_id: &str) -> StoreResult<Vec<ReceiptFile>> {
        let rows = query(select_receipt!("WHERE r.epoch_id = $1 ORDER BY r.seq"))
            .bind(epoch_id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Returns the receipt of a submission's latest grade.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn receipt_of(&self, submission_id: &str) -> StoreResult<Option<ReceiptFile>> {
        let row = query(select_receipt!("WHERE r.submission_id = $1 ORDER BY r.attempt DESC LIMIT 1"))
            .bind(submission_id)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref().map(read).transpose()
    }

    /// Returns the public keys that receipts were signed with, oldest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn receipt_keys(&self) -> StoreResult<Vec<String>> {
        query_scalar("SELECT public_key FROM receipts GROUP BY public_key ORDER BY MIN(seq)")
            .fetch_all(&self.readers)
            .await
    }
}
