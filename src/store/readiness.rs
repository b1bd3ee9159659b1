//! Readiness probe for `/readyz`: whether the database can be written and read.

use super::db::{Each, Row, query, query_scalar};
use super::location::Location;
use super::{Store, StoreResult, commit};

impl Store {
    /// Returns the bytes that are free on the disk of the database file; none if they are not known, as those of a server.
    pub async fn free_bytes(&self) -> Option<u64> {
        let Location::File(file) = &*self.location else { return None };
        let file = file.clone();
        let asked = tokio::task::spawn_blocking(move || {
            // The file may be a link to another disk.
            let file = std::fs::canonicalize(file).ok()?;
            let disk = rustix::fs::statvfs(file.parent()?).ok()?;
            // Some file systems, such as those in memory without a bound, tell nothing.
            (disk.f_blocks > 0).then(|| disk.f_bavail.saturating_mul(disk.f_frsize))
        });
        asked.await.ok().flatten()
    }

    /// Writes a row durably, and reads a row of each table.
    ///
    /// # Errors
    /// Returns an error if either fails, for example because of a full disk, a damaged file, or another process that
    /// locks the database.
    pub async fn probe(&self, now_ms: i64) -> StoreResult<()> {
        let tables: Vec<String> = query_scalar(Each {
            sqlite: "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'",
            postgres: "SELECT tablename FROM pg_tables WHERE schemaname = current_schema()",
        })
        .fetch_all(&self.readers)
        .await?;
        for table in tables {
            // A table name cannot be a bound value; this one comes from the schema.
            let read = format!("SELECT 1 FROM \"{}\" LIMIT 1", table.replace('"', "\"\""));
            let _: Option<Row> = query(sqlx::AssertSqlSafe(read)).fetch_optional(&self.readers).await?;
        }
        let mut tx = self.begin().await?;
        query("UPDATE readiness SET written_at_ms = $1 WHERE one = 1").bind(now_ms).execute(&mut tx).await?;
        commit(tx, "probe").await
    }
}
