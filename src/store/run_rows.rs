//! Rows of runs, and their counters.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection};

use super::states::RunState;
use super::{StoreError, StoreResult};
use plumbline_engine::grading::Summary;

/// Tasks that a run leaves out on purpose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Skip {
    /// All tasks without an answer.
    Unanswered,
    /// Tasks with these numbers.
    Tasks(Vec<u32>),
}

/// Row of a run.
#[derive(Debug, Clone)]
pub struct RunRow {
    /// Identifier of the run.
    pub id: String,
    /// Name of the agent.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite_id: String,
    /// Metadata that its owner provided, as JSON.
    pub metadata: serde_json::Value,
    /// State of the run.
    pub state: RunState,
    /// Number of submissions that are queued or being graded.
    pub pending: i64,
    /// Number of graded submissions.
    pub graded: i64,
    /// Number of submissions that ended because of a failure of ours and were not posted again.
    pub grader_errors: i64,
    /// Number of tasks in its suite.
    pub tasks: i64,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time at which it ended, in milliseconds since 1970.
    pub finished_at_ms: Option<i64>,
    /// Summary, once it has ended.
    pub summary: Option<Summary>,
    /// Owner who began it; none if the service was open to everyone.
    pub owner: Option<String>,
    /// Provenance of its logs.
    pub provenance: String,
    /// Number of tasks that it skips.
    pub skipped: i64,
}

/// Query with the columns of a run, for every query that reads one.
macro_rules! select_run {
    ($rest:literal) => {
        concat!(
            "SELECT r.id, r.agent, r.suite_id, r.metadata, r.state, r.pending, r.graded, r.grader_errors,
                    s.task_count AS tasks, r.created_at_ms, r.finished_at_ms, r.summary, r.owner, r.provenance,
                    r.deleted_at_ms, (SELECT COUNT(*) FROM skipped_tasks k WHERE k.run_id = r.id) AS skipped
             FROM runs r JOIN suites s ON s.id = r.suite_id ",
            $rest
        )
    };
}

pub(super) fn read_run(row: &SqliteRow) -> StoreResult<RunRow> {
    let summary: Option<&str> = row.try_get("summary")?;
    let corrupt = |error: serde_json::Error| StoreError::corrupt("runs", error);
    Ok(RunRow {
        id: row.try_get("id")?,
        agent: row.try_get("agent")?,
        suite_id: row.try_get("suite_id")?,
        metadata: serde_json::from_str(row.try_get("metadata")?).map_err(corrupt)?,
        state: match row.try_get::<Option<i64>, _>("deleted_at_ms")? {
            Some(_) => RunState::Deleted,
            None => row.try_get("state")?,
        },
        pending: row.try_get("pending")?,
        graded: row.try_get("graded")?,
        grader_errors: row.try_get("grader_errors")?,
        tasks: row.try_get("tasks")?,
        created_at_ms: row.try_get("created_at_ms")?,
        finished_at_ms: row.try_get("finished_at_ms")?,
        summary: summary.map(serde_json::from_str).transpose().map_err(corrupt)?,
        owner: row.try_get("owner")?,
        provenance: row.try_get("provenance")?,
        skipped: row.try_get("skipped")?,
    })
}

pub(super) use select_run;

/// Reads a run within the transaction.
pub(super) async fn run_in(tx: &mut SqliteConnection, id: &str) -> StoreResult<Option<RunRow>> {
    let row = sqlx::query(select_run!("WHERE r.id = $1")).bind(id).fetch_optional(&mut *tx).await?;
    row.as_ref().map(read_run).transpose()
}

/// Adds to a run's counters.
pub(super) async fn count(
    tx: &mut SqliteConnection,
    id: &str,
    pending: i64,
    graded: i64,
    grader_errors: i64,
) -> StoreResult<()> {
    sqlx::query(
        "UPDATE runs SET pending = pending + $2, graded = graded + $3, grader_errors = grader_errors + $4 WHERE id = $1",
    )
    .bind(id)
    .bind(pending)
    .bind(graded)
    .bind(grader_errors)
    .execute(&mut *tx)
    .await?;
    Ok(())
}
