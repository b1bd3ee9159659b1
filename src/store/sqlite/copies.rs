//! Copies of the whole database: backup while the service runs, and inspection of a copy.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _, SqliteConnection};

use crate::store::{StoreError, StoreResult};

/// What a copy holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contents {
    /// Number of runs.
    pub runs: i64,
    /// Number of submissions.
    pub submissions: i64,
    /// Number of reports.
    pub reports: i64,
    /// Place of the large logs and reports that it refers to; none if it has none.
    pub blobs: Option<String>,
}

/// Writes a consistent copy of a database to a file that must not exist. The service may keep running.
///
/// # Errors
/// Returns an error if the database cannot be read or the copy cannot be written.
pub async fn copy(database: &Path, file: &Path) -> StoreResult<()> {
    let mut connection = read_only(database).await?;
    // A single read transaction: writers can continue, and the copy is a consistent snapshot.
    sqlx::query("VACUUM INTO $1").bind(file.to_string_lossy().into_owned()).execute(&mut connection).await?;
    connection.close().await?;
    Ok(())
}

/// Checks that a copy is intact and belongs to this program.
///
/// # Errors
/// Returns an error if it is damaged or belongs to another program.
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
    // A copy of an old schema knows no places.
    let knows_places: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM sqlite_schema WHERE name = 'agreed')")
        .fetch_one(&mut connection)
        .await?;
    let blobs = if knows_places {
        let noted = sqlx::query_scalar("SELECT value FROM agreed WHERE name = 'blobs'");
        noted.fetch_optional(&mut connection).await?
    } else {
        None
    };
    connection.close().await?;
    Ok(Contents { runs, submissions, reports, blobs })
}

/// Opens a file read-only.
async fn read_only(file: &Path) -> StoreResult<SqliteConnection> {
    Ok(SqliteConnectOptions::new().filename(file).read_only(true).connect().await?)
}
