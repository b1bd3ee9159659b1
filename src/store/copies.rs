//! Copies of the whole database: backup while the service runs, restore, and export as files of lines.

use std::path::Path;

use futures_util::TryStreamExt as _;
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _, Row as _, SqliteConnection};

use super::{StoreError, StoreResult, decompress};

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

async fn read_only(file: &Path) -> StoreResult<SqliteConnection> {
    Ok(SqliteConnectOptions::new().filename(file).read_only(true).connect().await?)
}

/// A kind of thing that is exported, a line each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exported {
    /// Runs with their summaries.
    Runs,
    /// Submissions with their logs.
    Submissions,
    /// Reports.
    Reports,
}

impl Exported {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Runs, Self::Submissions, Self::Reports];

    /// Name of its file, without ending.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Runs => "runs",
            Self::Submissions => "submissions",
            Self::Reports => "reports",
        }
    }

    const fn query(self) -> &'static str {
        match self {
            Self::Runs => {
                "SELECT id, agent, suite_id, metadata, state, created_at_ms, finished_at_ms, summary FROM runs ORDER BY id"
            }
            Self::Submissions => {
                "SELECT id, run_id, suite_id, task_number, task_hash, log_hash, state, error, superseded, created_at_ms,
                        ended_at_ms, log
                 FROM submissions WHERE instance_id IS NULL ORDER BY id"
            }
            Self::Reports => {
                "SELECT submission_id, attempt, grader, graded_at_ms, grading_us, body FROM reports
                 WHERE submission_id IN (SELECT id FROM submissions WHERE instance_id IS NULL)
                 ORDER BY submission_id, attempt"
            }
        }
    }

    fn line(self, row: &sqlx::sqlite::SqliteRow) -> StoreResult<Value> {
        let text = |i: usize| row.try_get::<Option<String>, _>(i);
        let number = |i: usize| row.try_get::<Option<i64>, _>(i);
        let parsed = |table, text: Option<String>| -> StoreResult<Value> {
            let parse = |text: String| serde_json::from_str(&text).map_err(|e| StoreError::corrupt(table, e));
            text.map_or(Ok(Value::Null), parse)
        };
        let unpacked = |table, i: usize| -> StoreResult<Value> {
            let json = decompress(table, row.try_get(i)?)?;
            serde_json::from_slice(&json).map_err(|error| StoreError::corrupt(table, error))
        };
        Ok(match self {
            Self::Runs => json!({
                "id": text(0)?, "agent": text(1)?, "suite": text(2)?, "metadata": parsed("runs", text(3)?)?,
                "state": text(4)?, "created_at_ms": number(5)?, "finished_at_ms": number(6)?,
                "summary": parsed("runs", text(7)?)?,
            }),
            Self::Submissions => json!({
                "id": text(0)?, "run": text(1)?, "suite": text(2)?, "number": number(3)?, "task_hash": text(4)?,
                "log_hash": text(5)?, "state": text(6)?, "error": text(7)?, "superseded": number(8)? == Some(1),
                "created_at_ms": number(9)?, "ended_at_ms": number(10)?, "log": unpacked("submissions", 11)?,
            }),
            Self::Reports => json!({
                "submission": text(0)?, "attempt": number(1)?, "grader": text(2)?, "graded_at_ms": number(3)?,
                "grading_us": number(4)?, "report": unpacked("reports", 5)?,
            }),
        })
    }
}

/// Hands every row of every kind to `write`, all as of one moment.
///
/// # Errors
/// Where the database fails, a row does not read back, or `write` fails.
pub async fn export(
    database: &Path,
    mut write: impl FnMut(Exported, &Value) -> std::io::Result<()>,
) -> StoreResult<()> {
    let mut connection = read_only(database).await?;
    let mut moment = connection.begin().await?;
    for kind in Exported::ALL {
        let mut rows = sqlx::query(kind.query()).fetch(&mut *moment);
        while let Some(row) = rows.try_next().await? {
            let line = kind.line(&row)?;
            write(kind, &line).map_err(|error| StoreError::Database(sqlx::Error::Io(error)))?;
        }
    }
    moment.rollback().await?;
    connection.close().await?;
    Ok(())
}
