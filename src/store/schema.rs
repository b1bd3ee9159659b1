//! The schema of a database file: which migrations it has had, and bringing it up to date on purpose.

use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _};

use super::migrations::MIGRATOR;
use super::{Store, StoreError, StoreResult, copies};
use crate::clock::now_ms;

/// Which migrations a file has had, and which it lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaState {
    /// The last migration of the file; 0 where it is missing or empty.
    pub found: i64,
    /// The last one of this program.
    pub known: i64,
    /// Migrations that the file lacks: number and name.
    pub lacking: Vec<(i64, String)>,
    /// Whether there is a file.
    pub is_there: bool,
}

impl SchemaState {
    /// Refuses a file of a newer program.
    ///
    /// # Errors
    /// Where it is one.
    pub fn must_not_be_newer(&self, file: &Path) -> StoreResult<()> {
        if self.found <= self.known {
            return Ok(());
        }
        Err(StoreError::Newer { file: file.to_owned(), found: self.found, known: self.known })
    }

    /// Refuses a file that is missing, of a newer program, or not up to date.
    ///
    /// # Errors
    /// Where it is one of these.
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

/// Looks at a file without changing it.
///
/// # Errors
/// Where it is there and cannot be read, or is another program's.
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

/// Brings a file's schema up to date, after a copy was made beside it; gives the copy's path. A file that lacks nothing stays as it
/// is, without a copy.
///
/// # Errors
/// Where it is missing, of a newer program, or cannot be copied or changed; then it is as it was.
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
        // Of an earlier time, and not to be written over.
        copy = PathBuf::from(format!("{}.{}", copy.display(), now_ms()));
    }
    copies::copy(file, &copy).await?;
    Store::open(file).await?.close().await;
    Ok(Some(copy))
}
