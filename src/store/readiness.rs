//! Readiness probe for `/readyz`: whether the database can be written and read.

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use super::db::{Each, Row, query, query_scalar};
use super::location::Location;
use super::{Store, StoreResult, commit};

/// What tells a file from another that takes its place: the device and the inode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FileIdentity(u64, u64);

impl FileIdentity {
    /// Returns the identity of the file at a path; `None` if there is none.
    pub fn of(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|file| Self(file.dev(), file.ino()))
    }
}

impl Store {
    /// Returns whether the database file was deleted, moved or replaced since it was opened: what is written then is
    /// lost when the process ends.
    #[must_use]
    pub fn has_lost_its_file(&self) -> bool {
        self.location.file().is_some_and(|file| self.file.is_some() && FileIdentity::of(file) != self.file)
    }

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
