//! Idempotent requests: carried out once, however often they are sent. Their result is stored with their effect.

use super::db::{Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::{Store, StoreResult, commit};
use crate::clock::steady::{latest_believable_ms, steady_now_ms};

/// Time for which a key is remembered, in milliseconds.
pub const KEPT_MS: i64 = 24 * 60 * 60 * 1_000;

/// Identifies a request that must be carried out only once.
#[derive(Debug, Clone)]
pub struct IdempotencyKey {
    /// Owner of the API key that was used; empty if the service is open.
    pub owner: String,
    /// Value of the client's `Idempotency-Key`.
    pub key: String,
    /// SHA-256 of operation and body, in hex.
    pub body_hash: String,
}

/// Earlier use of an idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PriorRequest {
    /// The key was not used before.
    Never,
    /// The request was carried out; holds its result.
    Done(String),
    /// The key was used for a different request.
    OtherBody,
}

impl IdempotencyKey {
    /// Returns the lock that requests with this key take.
    pub(super) fn lock(&self) -> Lock<'_> {
        Lock::Request(&self.owner, &self.key)
    }

    /// Looks up earlier use of the key, within the transaction.
    pub(super) async fn before(&self, tx: &mut Tx, now_ms: i64) -> StoreResult<PriorRequest> {
        // A clock that jumps for moments must not have a request carried out twice.
        let now_ms = now_ms.min(steady_now_ms());
        let found: Option<(String, String)> =
            query_as("SELECT body_hash, result FROM idempotency WHERE owner = $1 AND key = $2 AND created_at_ms > $3")
                .bind(&self.owner)
                .bind(&self.key)
                .bind(now_ms - KEPT_MS)
                .fetch_optional(tx)
                .await?;
        Ok(match found {
            None => PriorRequest::Never,
            Some((hash, result)) if hash == self.body_hash => PriorRequest::Done(result),
            Some(_) => PriorRequest::OtherBody,
        })
    }

    /// Stores the result of the request.
    pub(super) async fn keep(&self, tx: &mut Tx, result: &str, now_ms: i64) -> StoreResult<()> {
        // A clock that is behind for moments must not have the key forgotten before its time.
        let now_ms = now_ms.max(latest_believable_ms());
        // The key may have been used more than a day ago.
        query(
            "INSERT INTO idempotency (owner, key, body_hash, result, created_at_ms) VALUES ($1, $2, $3, $4, $5)
             ON CONFLICT (owner, key) DO UPDATE SET
                 body_hash = excluded.body_hash, result = excluded.result, created_at_ms = excluded.created_at_ms",
        )
        .bind(&self.owner)
        .bind(&self.key)
        .bind(&self.body_hash)
        .bind(result)
        .bind(now_ms)
        .execute(tx)
        .await?;
        Ok(())
    }
}

impl Store {
    /// Deletes results of requests that are too old to be repeated.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn forget_old_requests(&self, now_ms: i64) -> StoreResult<()> {
        const ARE_THERE: &str = "SELECT EXISTS (SELECT 1 FROM idempotency WHERE created_at_ms <= $1)";
        let before_ms = now_ms - KEPT_MS;
        if !query_scalar(ARE_THERE).bind(before_ms).fetch_one(&self.readers).await? {
            return Ok(());
        }
        let mut tx = self.begin().await?;
        query("DELETE FROM idempotency WHERE created_at_ms <= $1").bind(before_ms).execute(&mut tx).await?;
        commit(tx, "forget_old_requests").await
    }
}
