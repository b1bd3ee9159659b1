//! Readiness probe for `/readyz`: whether the database can be written and read.

use super::db::{Each, Row, query, query_scalar};
use super::{Store, StoreResult, commit};

impl Store {
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
