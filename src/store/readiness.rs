//! Whether the database can be written and read: asked by `/readyz`.

use sqlx::AssertSqlSafe;

use super::{Store, StoreResult, commit};

impl Store {
    /// Writes a row durably, and reads a page of each table.
    ///
    /// # Errors
    /// Where either fails: a full disk, a damaged file, another process that holds the database.
    pub async fn probe(&self, now_ms: i64) -> StoreResult<()> {
        let tables: Vec<String> =
            sqlx::query_scalar("SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'")
                .fetch_all(&self.readers)
                .await?;
        for table in tables {
            // A table cannot be a bound value; its name comes from the schema.
            let read = format!("SELECT 1 FROM \"{}\" LIMIT 1", table.replace('"', "\"\""));
            sqlx::query(AssertSqlSafe(read)).fetch_optional(&self.readers).await?;
        }
        let mut tx = self.begin().await?;
        sqlx::query("UPDATE readiness SET written_at_ms = $1 WHERE one = 1").bind(now_ms).execute(&mut *tx).await?;
        commit(tx, "probe").await
    }
}
