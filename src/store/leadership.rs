//! Leadership: of the nodes of a PostgreSQL database, one does the tasks that are done once for all.

use super::db::{query, query_scalar};
use super::{Store, StoreResult, commit};
use crate::store::db::Dialect;

impl Store {
    /// Returns whether this node does a task now. A node that leads stays the leader for `lease_ms` after each call;
    /// when it dies, another takes over. The clock of the server counts. A SQLite file has one leader: whoever asks.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn lead(&self, task: &str, node: &str, lease_ms: i64) -> StoreResult<bool> {
        if self.readers.dialect() == Dialect::Sqlite {
            return Ok(true);
        }
        let mut tx = self.begin().await?;
        let leader: Option<String> = query_scalar(
            "INSERT INTO leases (name, holder, lease_until_ms) VALUES ($1, $2, now_ms() + $3)
             ON CONFLICT (name) DO UPDATE SET holder = excluded.holder, lease_until_ms = excluded.lease_until_ms
             WHERE leases.holder = excluded.holder OR leases.lease_until_ms <= now_ms()
             RETURNING holder",
        )
        .bind(task)
        .bind(node)
        .bind(lease_ms)
        .fetch_optional(&mut tx)
        .await?;
        commit(tx, "lead").await?;
        Ok(leader.is_some())
    }

    /// Hands a task over to whichever node asks next.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn stop_leading(&self, task: &str, node: &str) -> StoreResult<()> {
        if self.readers.dialect() == Dialect::Sqlite {
            return Ok(());
        }
        let mut tx = self.begin().await?;
        query("DELETE FROM leases WHERE name = $1 AND holder = $2").bind(task).bind(node).execute(&mut tx).await?;
        commit(tx, "stop_leading").await
    }
}
