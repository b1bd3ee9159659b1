//! Readiness probe for `/readyz`: whether the database can be written and read.

use std::path::Path;

use super::db::{Each, Row, query, query_scalar};
use super::location::Location;
use super::{Store, StoreResult, commit};

/// Bytes that must be free on the disk of a database file: what a large submission takes, with its report.
const ROOM: u64 = 2 << 20;

impl Store {
    /// Returns whether the disk of the database file has room for submissions. What a server has is not known here.
    ///
    /// # Errors
    /// Returns an error if the disk cannot be asked.
    pub fn has_room(&self) -> std::io::Result<bool> {
        let Location::File(file) = &*self.location else { return Ok(true) };
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let disk = rustix::fs::statvfs(folder)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize) >= ROOM)
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
