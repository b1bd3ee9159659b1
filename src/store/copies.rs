//! Copies of the whole database: backup while the service runs, and restore.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _, SqliteConnection};

use super::{StoreError, StoreResult};

/// How many rows a copy holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contents {
    /// Runs.
    pub runs: i64,
    /// Submissions.
    pub submissions: i64,
    /// Reports.
    pub reports: i64,
}

/// Writes a consistent copy of a database to a file that must not exist. The service may go on meanwhile.
///
/// # Errors
/// Where the database cannot be read or the copy not be written.
pub async fn copy(database: &Path, file: &Path) -> StoreResult<()> {
    let mut connection = read_only(database).await?;
    // One read transaction: writers go on, and the copy shows one moment.
    sqlx::query("VACUUM INTO $1").bind(file.to_string_lossy().into_owned()).execute(&mut connection).await?;
    connection.close().await?;
    Ok(())
}

/// Looks through a copy: whole, and of this program.
///
/// # Errors
/// Where it is damaged or another program's.
pub async fn inspect(file: &Path) -> StoreResult<Contents> {
    let mut connection = read_only(file).await?;
    let found: String = sqlx::query_scalar("PRAGMA integrity_check").fetch_one(&mut connection).await?;
    if found != "ok" {
        return Err(StoreError::corrupt("the file", found));
    }
    let ours: i64 = sqlx::query_scalar(
        "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND name IN ('_sqlx_migrations', 'submissions')",
    )
    .fetch_one(&mut connection)
    .await?;
    if ours != 2 {
        return Err(StoreError::Foreign);
    }
    let (runs, submissions, reports) = sqlx::query_as(
        "SELECT (SELECT COUNT(*) FROM runs), (SELECT COUNT(*) FROM submissions), (SELECT COUNT(*) FROM reports)",
    )
    .fetch_one(&mut connection)
    .await?;
    connection.close().await?;
    Ok(Contents { runs, submissions, reports })
}

/// Opens a file that is only read.
pub(super) async fn read_only(file: &Path) -> StoreResult<SqliteConnection> {
    Ok(SqliteConnectOptions::new().filename(file).read_only(true).connect().await?)
}
