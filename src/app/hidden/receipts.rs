//! Receipts: the public log of grades, and the keys that verify it.

use super::log::inclusion;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::clock::now_ms;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::{LogHead, LogPage, ReceiptFile};

/// Public keys that verify receipts, in hex.
#[derive(Debug)]
pub struct VerifyingKeys {
    /// Ed25519 key in use.
    pub in_use: String,
    /// Keys of all receipts in the log and the key in use, in the order of first use.
    pub all: Vec<String>,
}

/// Parses a stored receipt.
///
/// # Errors
/// Returns an error if the stored text is not a receipt.
pub(super) fn given(stored: Option<&str>) -> AppResult<Option<GivenReceipt>> {
    stored.map(serde_json::from_str).transpose().map_err(|error| AppError::damaged("handed out receipts", error))
}

/// Returns a page of the log after a position, with the signed end of the log.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn log_page(app: &App, after: i64, items: usize) -> AppResult<LogPage> {
    // Reads the end of the log first: receipts that are added meanwhile belong to the next page.
    let (size, link) = app.store.log_end().await?;
    let mut receipts = app.store.receipts(after, items as i64 + 1).await?;
    receipts.retain(|receipt| receipt.seq <= size);
    let has_more = receipts.len() > items;
    receipts.truncate(items);
    let next_after = receipts.last().filter(|_| has_more).map(|last| last.seq);
    let head = app.signer.as_ref().map(|signer| LogHead::signed(size, link, now_ms(), signer));
    Ok(LogPage { receipts, next_after, head })
}

/// Returns the receipt of a submission's latest grade by a worker.
///
/// # Errors
/// Returns an error (404) if there is no such submission, or if it has no receipt.
pub async fn receipt_of_submission(app: &App, id: &str) -> AppResult<ReceiptFile> {
    if app.store.submission(id).await?.is_none() {
        return Err(AppError::not_found(format!("there is no submission {id:?}")));
    }
    let receipt = app.store.receipt_of(id).await?.map(|receipt| receipt.with_place(app.signer.as_deref()));
    let missing =
        || AppError::not_found("the submission has no receipt: it is ungraded, or older than the log of receipts");
    let mut receipt = receipt.ok_or_else(missing)?;
    // A node without secrets serves the receipt without the proof, as it does without the signature over its place.
    if app.signer.is_some() {
        receipt.inclusion = Some(inclusion(app, receipt.seq).await?);
    }
    Ok(receipt)
}

/// Returns the public keys that verify this service's receipts.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn verifying_keys(app: &App) -> AppResult<VerifyingKeys> {
    let mut all = app.store.receipt_keys().await?;
    let in_use = app.receipt_key.clone();
    if !all.contains(&in_use) {
        all.push(in_use.clone());
    }
    Ok(VerifyingKeys { in_use, all })
}
