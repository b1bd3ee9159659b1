//! Schema of a database file: which migrations it has, and migration on request.

use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _};

use super::migrations::MIGRATOR;
use super::{Store, StoreError, StoreResult, copies};
use crate::clock::now_ms;

/// Migrations that a file has and lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaState {
    /// Version of the file's last migration; 0 if the file is missing or empty.
    pub found: i64,
    /// Version of this program's last migration.
    pub known: i64,
    /// Migrations that the file lacks, as number and name.
    pub lacking: Vec<(i64, String)>,
    /// Whether the file exists.
    pub is_there: bool,
}

impl SchemaState {
    /// Checks that the file was not written by a newer program.
    ///
    /// # Errors
    /// Returns an error if it was.
    pub fn must_not_be_newer(&self, file: &Path) -> StoreResult<()> {
        if self.found <= self.known {
            return Ok(());
        }
        Err(StoreError::Newer { file: file.to_owned(), found: self.found, known: self.known })
    }

    /// Checks that the file exists, was not written by a newer program, and is up to date.
    ///
    /// # Errors
    /// Returns an error if one of these does not hold.
    pub fn must_be_current(&self, file: &Path) -> StoreResult<()> {
        if !self.is_there {
            return Err(StoreError::Missing(file.to_owned()));
        }
        self.must_not_be_newer(file)?;
        if self.lacking.is_empty() {
            return Ok(());
        }
        Err(StoreError::Older { file: file.to_owned(), found: self.found, known: self.known })
    }
}

/// Reads the schema state of a file without changing the file.
///
/// # Errors
/// Returns an error if the file exists but cannot be read, or belongs to another program.
pub async fn state(file: &Path) -> StoreResult<SchemaState> {
    let known = MIGRATOR.iter().map(|migration| migration.version).max().unwrap_or(0);
    let all = || MIGRATOR.iter().map(|migration| (migration.version, migration.description.to_string()));
    if !file.exists() {
        return Ok(SchemaState { found: 0, known, lacking: all().collect(), is_there: false });
    }
    let mut connection = SqliteConnectOptions::new().filename(file).read_only(true).connect().await?;
    let (tables, ours): (i64, i64) = sqlx::query_as(
        "SELECT COUNT(*), COALESCE(SUM(name = '_sqlx_migrations'), 0) FROM sqlite_master WHERE type = 'table'",
    )
    .fetch_one(&mut connection)
    .await?;
    if tables > 0 && ours == 0 {
        return Err(StoreError::Foreign);
    }
    let had: Vec<i64> = if ours == 0 {
        Vec::new()
    } else {
        sqlx::query_scalar("SELECT version FROM _sqlx_migrations WHERE success").fetch_all(&mut connection).await?
    };
    connection.close().await?;
    let lacking = all().filter(|(version, _)| !had.contains(version)).collect();
    Ok(SchemaState { found: had.into_iter().max().unwrap_or(0), known, lacking, is_there: true })
}

/// Migrates a file after copying it to a file beside it, and returns the path of the copy. A file that is up to date is
/// not changed or copied.
///
/// # Errors
/// Returns an error if the file is missing, was written by a newer program, or cannot be copied or migrated.
pub async fn migrate(file: &Path) -> StoreResult<Option<PathBuf>> {
    let before = state(file).await?;
    if !before.is_there {
        return Err(StoreError::Missing(file.to_owned()));
    }
    before.must_not_be_newer(file)?;
    if before.lacking.is_empty() {
        return Ok(None);
    }
    let mut copy = PathBuf::from(format!("{}.schema-{}", file.display(), before.found));
    if copy.exists() {
        // The copy is from an earlier migration and must not be overwritten.
        copy = PathBuf::from(format!("{}.{}", copy.display(), now_ms()));
    }
    copies::copy(file, &copy).await?;
    Store::open(file).await?.close().await;
    Ok(Some(copy))
}
