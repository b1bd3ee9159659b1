//! The key that signs receipts: a change of it is recorded in their log.

use sqlx::AssertSqlSafe;

use super::db::{query, query_scalar};
use super::locks::Lock;
use super::pending::publish;
use super::receipts::{NewReceipt, enter};
use super::{Store, StoreResult, commit};
use plumbline_engine::hidden::receipts::{Signer, key_change};

/// Selects the keys of the last receipt and of those that are not published.
const KEYS: &str = "SELECT DISTINCT public_key FROM (SELECT public_key FROM pending_receipts UNION ALL
                    SELECT public_key FROM (SELECT public_key FROM receipts ORDER BY seq DESC LIMIT 1) AS last) AS used";

impl Store {
    /// Records a change of the key that signs receipts if the last receipt was signed with another key, and returns
    /// that key.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn note_receipt_key(&self, signer: &Signer, now_ms: i64) -> StoreResult<Option<String>> {
        const LAST: &str = "SELECT public_key FROM receipts ORDER BY seq DESC LIMIT 1";
        let is_other = |last: &String| *last != signer.public_key();
        // Nearly always there is nothing to write, so the start need not wait for another process that writes.
        if !self.used_receipt_keys().await?.iter().any(is_other) {
            return Ok(None);
        }
        let mut tx = self.begin().await?;
        tx.lock([Lock::Order]).await?;
        // Receipts signed with the old key are published before the change.
        publish(&mut tx, None).await?;
        let last: Option<String> = query_scalar(LAST).fetch_optional(&mut tx).await?;
        let Some(before) = last.filter(is_other) else {
            commit(tx, "note_receipt_key").await?;
            return Ok(None);
        };
        let signed = signer.sign(&key_change(&before, &signer.public_key(), now_ms));
        enter(&mut tx, &[NewReceipt { of: None, epoch_id: None, signed: &signed }]).await?;
        commit(tx, "note_receipt_key").await?;
        Ok(Some(before))
    }

    /// Returns the number of other processes of this program that are connected to the server. A command counts while it
    /// runs.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn other_nodes(&self) -> StoreResult<i64> {
        const OTHERS: &str = "SELECT COUNT(DISTINCT application_name) FROM pg_stat_activity
                              WHERE datname = current_database() AND application_name ~ '^plumbline( [0-9a-f]{32})?$'
                              AND application_name <> current_setting('application_name')";
        query_scalar(OTHERS).fetch_one(&self.readers).await
    }

    /// Returns the keys of the last receipt and of those that are not published; none if nothing was ever signed.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn used_receipt_keys(&self) -> StoreResult<Vec<String>> {
        query_scalar(KEYS).fetch_all(&self.readers).await
    }

    /// Lets all nodes of a PostgreSQL database agree on the key that signs receipts. The first key that is proposed
    /// holds; with `replaces` the proposed one holds from now on. Returns the key that holds; none if none was proposed
    /// yet.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn agree_on_receipt_key(&self, proposed: Option<&str>, replaces: bool) -> StoreResult<Option<String>> {
        const HELD: &str = "SELECT value FROM agreed WHERE name = 'receipt key'";
        let held: Option<String> = query_scalar(HELD).fetch_optional(&self.readers).await?;
        let Some(proposed) = proposed.filter(|_| held.is_none() || replaces) else { return Ok(held) };
        let mut tx = self.begin().await?;
        tx.lock([Lock::Order]).await?;
        let conflict = if replaces { "UPDATE SET value = excluded.value" } else { "NOTHING" };
        let upsert =
            format!("INSERT INTO agreed (name, value) VALUES ('receipt key', $1) ON CONFLICT (name) DO {conflict}");
        query(AssertSqlSafe(upsert)).bind(proposed).execute(&mut tx).await?;
        let held: Option<String> = query_scalar(HELD).fetch_optional(&mut tx).await?;
        commit(tx, "agree_on_receipt_key").await?;
        Ok(held)
    }
}
