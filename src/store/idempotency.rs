//! Requests that are carried out once however often they come: what they came to is kept with their effect.

use sqlx::SqliteConnection;

use super::StoreResult;

/// How long a key is remembered.
pub const KEPT_MS: i64 = 24 * 60 * 60 * 1_000;

/// Names a request that shall be carried out once.
#[derive(Debug, Clone)]
pub struct Once {
    /// Owner of the key that was used; empty where the service is open.
    pub owner: String,
    /// The client's `Idempotency-Key`.
    pub key: String,
    /// SHA-256 over operation and body, in hex.
    pub body_hash: String,
}

/// What is known of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Before {
    /// It is new.
    Never,
    /// It was carried out, and came to this.
    Done(String),
    /// Its key was used for another request.
    OtherBody,
}

impl Once {
    /// What is known of the request, as the transaction sees it.
    pub(super) async fn before(&self, tx: &mut SqliteConnection, now_ms: i64) -> StoreResult<Before> {
        let found: Option<(String, String)> = sqlx::query_as(
            "SELECT body_hash, result FROM idempotency WHERE owner = $1 AND key = $2 AND created_at_ms > $3",
        )
        .bind(&self.owner)
        .bind(&self.key)
        .bind(now_ms - KEPT_MS)
        .fetch_optional(tx)
        .await?;
        Ok(match found {
            None => Before::Never,
            Some((hash, result)) if hash == self.body_hash => Before::Done(result),
            Some(_) => Before::OtherBody,
        })
    }

    /// Keeps what the request came to; forgets what is too old.
    pub(super) async fn keep(&self, tx: &mut SqliteConnection, result: &str, now_ms: i64) -> StoreResult<()> {
        sqlx::query("DELETE FROM idempotency WHERE created_at_ms <= $1")
            .bind(now_ms - KEPT_MS)
            .execute(&mut *tx)
            .await?;
        sqlx::query(
            "INSERT INTO idempotency (owner, key, body_hash, result, created_at_ms) VALUES ($1, $2, $3, $4, $5)",
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
