//! Runs: attempts of an agent at a suite.
//!
//! A run ends by itself when every task of its suite has been graded, or when its owner has finished it and nothing is
//! pending. A failure of ours keeps it from ending until the task is posted again.

use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row as _, SqliteConnection};

use super::events::{self, NewEvent};
use super::idempotency::{Before, Once};
use super::job_ends::End;
use super::run_ends::{end_if_complete, skip_tasks};
use super::submissions::SubmissionState;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::grading::Summary;

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// Accepts submissions.
    Open,
    /// Accepts no more submissions; some are still being graded.
    Finishing,
    /// Ended, with a summary.
    Finished,
    /// Deleted by its owner while it was open.
    Deleted,
}

/// Filter for listing runs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunsWanted {
    /// State of the runs; if none, all but deleted runs.
    pub state: Option<RunState>,
    /// Suite of the runs, as `name@version`, or as a name for all versions.
    pub suite_id: Option<String>,
    /// Part of the agent's name, case-insensitive.
    pub agent: Option<String>,
    /// Owner of the runs.
    pub owner: Option<String>,
    /// Earliest time of beginning, inclusive, in milliseconds since 1970.
    pub since_ms: Option<i64>,
    /// Latest time of beginning, exclusive, in milliseconds since 1970.
    pub until_ms: Option<i64>,
    /// Identifier of a run; only runs begun before it are listed.
    pub after: Option<String>,
}

/// Tasks that a run leaves out on purpose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Skip {
    /// All tasks without an answer.
    Unanswered,
    /// Tasks with these numbers.
    Tasks(Vec<u32>),
}

/// Outcome of finishing or deleting a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunChanged {
    /// The change was made.
    Done,
    /// The run does not exist.
    NoSuchRun,
    /// The run is not open any more; holds its state.
    NotOpen(RunState),
    /// These tasks were answered and therefore cannot be skipped.
    Answered(Vec<u32>),
}

impl RunState {
    /// Returns the name of the state in the API and the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Finishing => "finishing",
            Self::Finished => "finished",
            Self::Deleted => "deleted",
        }
    }

    fn read(name: &str) -> StoreResult<Self> {
        [Self::Open, Self::Finishing, Self::Finished]
            .into_iter()
            .find(|state| state.name() == name)
            .ok_or_else(|| StoreError::corrupt("runs", format!("state {name:?}")))
    }
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

/// Run to store.
#[derive(Debug, Clone, Copy)]
pub struct NewRun<'a> {
    /// Identifier of the run.
    pub id: &'a str,
    /// Name of the agent.
    pub agent: &'a str,
    /// `name@version` of its suite.
    pub suite_id: &'a str,
    /// Metadata that its owner provides, as JSON.
    pub metadata: &'a serde_json::Value,
    /// Owner of the key that begins it.
    pub owner: Option<&'a str>,
    /// Provenance of its logs.
    pub provenance: &'a str,
}

/// Query with the columns of a run, for every query that reads one.
macro_rules! select_run {
    ($rest:literal) => {
        concat!(
            "SELECT r.id, r.agent, r.suite_id, r.metadata, r.state, r.pending, r.graded, r.grader_errors,
                    s.task_count, r.created_at_ms, r.finished_at_ms, r.summary, r.owner, r.provenance,
                    r.deleted_at_ms, (SELECT COUNT(*) FROM skipped_tasks k WHERE k.run_id = r.id)
             FROM runs r JOIN suites s ON s.id = r.suite_id ",
            $rest
        )
    };
}

pub(super) fn read_run(row: &SqliteRow) -> StoreResult<RunRow> {
    let summary: Option<&str> = row.try_get(11)?;
    let corrupt = |error: serde_json::Error| StoreError::corrupt("runs", error);
    Ok(RunRow {
        id: row.try_get(0)?,
        agent: row.try_get(1)?,
        suite_id: row.try_get(2)?,
        metadata: serde_json::from_str(row.try_get(3)?).map_err(corrupt)?,
        state: match row.try_get::<Option<i64>, _>(14)? {
            Some(_) => RunState::Deleted,
            None => RunState::read(row.try_get(4)?)?,
        },
        pending: row.try_get(5)?,
        graded: row.try_get(6)?,
        grader_errors: row.try_get(7)?,
        tasks: row.try_get(8)?,
        created_at_ms: row.try_get(9)?,
        finished_at_ms: row.try_get(10)?,
        summary: summary.map(serde_json::from_str).transpose().map_err(corrupt)?,
        owner: row.try_get(12)?,
        provenance: row.try_get(13)?,
        skipped: row.try_get(15)?,
    })
}

impl Store {
    /// Stores a new run. If the idempotency key was used before, returns the earlier use instead.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn create_run(&self, run: &NewRun<'_>, once: Option<&Once>, now_ms: i64) -> StoreResult<Before> {
        let mut tx = self.begin().await?;
        if let Some(once) = once {
            let before = once.before(&mut tx, now_ms).await?;
            if before != Before::Never {
                return Ok(before);
            }
            once.keep(&mut tx, run.id, now_ms).await?;
        }
        sqlx::query(
            "INSERT INTO runs (id, agent, suite_id, metadata, state, created_at_ms, owner, provenance)
             VALUES ($1, $2, $3, $4, 'open', $5, $6, $7)",
        )
        .bind(run.id)
        .bind(run.agent)
        .bind(run.suite_id)
        .bind(run.metadata.to_string())
        .bind(now_ms)
        .bind(run.owner)
        .bind(run.provenance)
        .execute(&mut *tx)
        .await?;
        commit(tx, "create_run").await?;
        Ok(Before::Never)
    }

    /// Returns the run with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn run(&self, id: &str) -> StoreResult<Option<RunRow>> {
        let row = sqlx::query(select_run!("WHERE r.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read_run).transpose()
    }

    /// Returns at most `limit` runs that match the filter, latest first.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn runs(&self, wanted: &RunsWanted, limit: i64) -> StoreResult<Vec<RunRow>> {
        let mut query = QueryBuilder::new(select_run!("WHERE "));
        match wanted.state {
            None => query.push("r.deleted_at_ms IS NULL"),
            Some(RunState::Deleted) => query.push("r.deleted_at_ms IS NOT NULL"),
            Some(state) => query.push("r.deleted_at_ms IS NULL AND r.state = ").push_bind(state.name()),
        };
        if let Some(suite) = &wanted.suite_id {
            // A name without version matches all versions.
            query.push(" AND (r.suite_id = ").push_bind(suite.clone());
            query.push(" OR s.name = ").push_bind(suite.clone()).push(")");
        }
        if let Some(owner) = &wanted.owner {
            query.push(" AND r.owner = ").push_bind(owner.clone());
        }
        if let Some(agent) = &wanted.agent {
            query.push(" AND instr(lower(r.agent), ").push_bind(agent.to_ascii_lowercase()).push(") > 0");
        }
        if let Some(since) = wanted.since_ms {
            query.push(" AND r.created_at_ms >= ").push_bind(since);
        }
        if let Some(until) = wanted.until_ms {
            query.push(" AND r.created_at_ms < ").push_bind(until);
        }
        if let Some(after) = &wanted.after {
            query.push(" AND (r.created_at_ms, r.id) < (SELECT created_at_ms, id FROM runs WHERE id = ");
            query.push_bind(after.clone()).push(")");
        }
        query.push(" ORDER BY r.created_at_ms DESC, r.id DESC LIMIT ").push_bind(limit);
        query.build().fetch_all(&self.readers).await?.iter().map(read_run).collect()
    }

    /// Deletes an open run: cancels its unfinished submissions, and accepts no more.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn delete_run(&self, id: &str, now_ms: i64) -> StoreResult<RunChanged> {
        let mut tx = self.begin().await?;
        let Some(run) = run_in(&mut tx, id).await? else { return Ok(RunChanged::NoSuchRun) };
        if run.state != RunState::Open {
            return Ok(RunChanged::NotOpen(run.state));
        }
        sqlx::query("UPDATE runs SET deleted_at_ms = $2 WHERE id = $1").bind(id).bind(now_ms).execute(&mut *tx).await?;
        let waiting: Vec<String> = sqlx::query_scalar(
            "SELECT s.id FROM submissions s JOIN jobs j ON j.submission_id = s.id WHERE s.run_id = $1 ORDER BY s.id",
        )
        .bind(id)
        .fetch_all(&mut *tx)
        .await?;
        for submission_id in &waiting {
            let end = End { submission_id, run_id: Some(id), state: SubmissionState::Cancelled };
            end.record(&mut tx, &*self.signer()?, "its run was deleted by its owner", &run.suite_id, now_ms).await?;
        }
        let ended = NewEvent { run_id: Some(id), submission_id: None, state: RunState::Deleted.name(), overall: None };
        events::enter(&mut tx, &[ended], now_ms).await?;
        commit(tx, "delete_run").await?;
        self.note_ends(false);
        Ok(RunChanged::Done)
    }

    /// Finishes a run: accepts no more submissions, records the tasks to skip, and ends the run if nothing is pending.
    /// A run that is finishing or finished stays as it is, and none of its tasks can be skipped then.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn finish_run(&self, id: &str, skip: Option<&Skip>, now_ms: i64) -> StoreResult<RunChanged> {
        let mut tx = self.begin().await?;
        let Some(run) = run_in(&mut tx, id).await? else { return Ok(RunChanged::NoSuchRun) };
        if run.state == RunState::Deleted || (run.state != RunState::Open && skip.is_some()) {
            return Ok(RunChanged::NotOpen(run.state));
        }
        if let Some(skip) = skip {
            let answered = skip_tasks(&mut tx, &run, skip).await?;
            if !answered.is_empty() {
                return Ok(RunChanged::Answered(answered));
            }
        }
        let found = sqlx::query("UPDATE runs SET state = 'finishing' WHERE id = $1 AND state = 'open'")
            .bind(id)
            .execute(&mut *tx)
            .await?
            .rows_affected();
        let has_ended = found > 0 && end_if_complete(&mut tx, id, &run.suite_id, now_ms).await?;
        commit(tx, "finish_run").await?;
        self.note_ends(has_ended);
        Ok(RunChanged::Done)
    }
}

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
