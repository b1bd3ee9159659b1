//! Deletes objects that no row refers to: those of transactions that failed, and of discarded regrades.

use std::collections::HashSet;

use futures_util::TryStreamExt as _;
use object_store::ObjectStoreExt as _;

use super::{Opened, Reference};
use crate::clock::{DAY_MS, rfc3339};
use crate::store::db::{Builder, query, query_scalar};
use crate::store::{Store, StoreResult, commit};

/// Number of objects that are looked up at once.
const AT_ONCE: usize = 500;
/// Days after which an object that no row refers to is an orphan. A row is written within a minute of its object; the
/// rest allows for clocks that differ between nodes.
const DAYS: i64 = 2;
/// Columns that may refer to objects.
const COLUMNS: [(&str, &str); 3] = [("submissions", "log"), ("reports", "body"), ("regraded", "body")];

impl Store {
    /// Returns whether there are blobs, and they were last swept a day ago.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn is_sweep_due(&self, now_ms: i64) -> StoreResult<bool> {
        const SWEPT: &str = "SELECT value FROM agreed WHERE name = 'blobs swept'";
        if self.blobs.opened().is_none() {
            return Ok(false);
        }
        let swept: Option<String> = query_scalar(SWEPT).fetch_optional(&self.readers).await?;
        let swept_ms = swept.and_then(|swept| swept.parse::<i64>().ok());
        Ok(!swept_ms.is_some_and(|swept_ms| (swept_ms..swept_ms + DAY_MS).contains(&now_ms)))
    }

    /// Deletes objects that are older than two days and to which no row refers. Returns their number. If two nodes do it at
    /// the same time, both do the same.
    ///
    /// # Errors
    /// Returns an error if the place or the database fails; then the rest is left for the next time.
    pub async fn sweep_blobs(&self, now_ms: i64) -> StoreResult<usize> {
        let Some(opened) = self.blobs.opened() else { return Ok(0) };
        let before = rfc3339(now_ms - DAYS * DAY_MS);
        let mut deleted = 0;
        let mut objects = opened.objects.list(None).try_chunks(AT_ONCE);
        loop {
            let chunk = objects.try_next().await.map_err(|error| opened.failed(&"".into(), &error.1))?;
            let Some(chunk) = chunk else { break };
            let old = chunk.iter().filter_map(|object| Reference::at(&object.location));
            let old: Vec<Reference> = old.filter(|reference| reference.day() < &before[..10]).collect();
            deleted += self.delete_orphans(&opened, old).await?;
        }
        let mut tx = self.begin().await?;
        query(
            "INSERT INTO agreed (name, value) VALUES ('blobs swept', $1)
             ON CONFLICT (name) DO UPDATE SET value = excluded.value",
        )
        .bind(now_ms.to_string())
        .execute(&mut tx)
        .await?;
        commit(tx, "sweep_blobs").await?;
        Ok(deleted)
    }

    /// Deletes those objects to which no row refers.
    async fn delete_orphans(&self, opened: &Opened, old: Vec<Reference>) -> StoreResult<usize> {
        if old.is_empty() {
            return Ok(0);
        }
        let mut select = Builder::new("");
        for (i, (table, column)) in COLUMNS.into_iter().enumerate() {
            select.push(if i == 0 { "" } else { " UNION ALL " });
            select.push("SELECT ").push(column).push(" FROM ").push(table);
            select.push(" WHERE length(").push(column).push(") = 82 AND ").push(column).push(" IN ");
            select.push_list(old.iter().map(Reference::to_column));
        }
        let held: Vec<(Vec<u8>,)> = select.build_as().fetch_all(&self.readers).await?;
        let held: HashSet<Vec<u8>> = held.into_iter().map(|(column,)| column).collect();
        let mut deleted = 0;
        for orphan in old.iter().filter(|reference| !held.contains(&reference.to_column())) {
            let path = orphan.path();
            match opened.objects.delete(&path).await {
                Ok(()) => deleted += 1,
                Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(opened.failed(&path, &error)),
            }
        }
        Ok(deleted)
    }
}
