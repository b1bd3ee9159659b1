//! What operators see of the whole service: the queue by owner, and quotas.

use super::db::query_as;
use super::quota::QuotaRow;
use super::{Store, StoreResult};

/// Waiting and running work of one owner in one lane. Answers to hidden instances are left out.
#[derive(Debug)]
pub struct QueueRow {
    /// Name of the lane.
    pub lane: String,
    /// Owner of the submissions; empty if they were made without a key.
    pub owner: String,
    /// Number of submissions that have not ended.
    pub open: i64,
    /// Number of those that a worker has leased.
    pub leased: i64,
    /// Greatest number of attempts at one of them.
    pub attempts: i64,
    /// Time at which the oldest was queued, in milliseconds since 1970.
    pub oldest_ms: i64,
    /// End of the lease that ends last, in milliseconds since 1970; 0 without a lease.
    pub lease_until_ms: i64,
}

impl Store {
    /// Returns what waits and runs, by lane and owner, most first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn queue_by_owner(&self, now_ms: i64, limit: i64) -> StoreResult<Vec<QueueRow>> {
        let rows: Vec<(String, String, i64, i64, i64, i64, i64)> = query_as(
            "SELECT lane, owner, COUNT(*), COUNT(CASE WHEN lease_until_ms > $1 THEN 1 END), CAST(MAX(attempt) AS BIGINT),
                    MIN(queued_at_ms), MAX(lease_until_ms)
             FROM jobs WHERE lane <> 'hidden' GROUP BY lane, owner ORDER BY COUNT(*) DESC, lane, owner LIMIT $2",
        )
        .bind(now_ms)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let row = |(lane, owner, open, leased, attempts, oldest_ms, lease_until_ms)| QueueRow {
            lane,
            owner,
            open,
            leased,
            attempts,
            oldest_ms,
            lease_until_ms,
        };
        Ok(rows.into_iter().map(row).collect())
    }

    /// Returns quotas with what is used of them, those in use first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn quotas(&self, limit: i64) -> StoreResult<Vec<QuotaRow>> {
        let rows: Vec<(String, Option<i64>, i64, i64, i64)> = query_as(
            "SELECT owner, granted, reserved, charged, used_before FROM quotas ORDER BY reserved DESC, charged DESC, owner LIMIT $1",
        )
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let row = |(owner, granted, reserved, charged, used_before)| QuotaRow {
            owner,
            granted,
            reserved,
            charged,
            used_before,
        };
        Ok(rows.into_iter().map(row).collect())
    }
}
