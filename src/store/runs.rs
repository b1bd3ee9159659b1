//! Runs: one agent's attempt at a suite.
//!
//! A run ends by itself when every task of its suite has been graded, or when its owner says that no more will come
//! and nothing is pending. A failure of ours keeps it from ending until the task is posted again.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection};

use super::boards::enter_result;
use super::events::{self, NewEvent};
use super::idempotency::{Before, Once};
use super::suites::tasks_of;
use super::{Store, StoreError, StoreResult, commit};
use crate::grading::fingerprints::Fingerprint;
use crate::grading::outcomes::Outcomes;
use crate::grading::{ProblemScores, Summary};
use crate::tasks::Task;

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunState {
    /// Takes submissions.
    Open,
    /// Takes no more; some are still being graded.
    Finishing,
    /// Ended, with a summary.
    Finished,
}

impl RunState {
    /// Its name in the API and the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Finishing => "finishing",
            Self::Finished => "finished",
        }
    }

    fn read(name: &str) -> StoreResult<Self> {
        [Self::Open, Self::Finishing, Self::Finished]
            .into_iter()
            .find(|state| state.name() == name)
            .ok_or_else(|| StoreError::corrupt("runs", format!("state {name:?}")))
    }
}

/// A stored run.
#[derive(Debug, Clone)]
pub struct RunRow {
    /// Its id.
    pub id: String,
    /// Who built.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite_id: String,
    /// What its owner says about it, as JSON.
    pub metadata: serde_json::Value,
    /// Its state.
    pub state: RunState,
    /// Submissions queued or being graded.
    pub pending: i64,
    /// Submissions graded.
    pub graded: i64,
    /// Submissions ended by a failure of ours and not posted again.
    pub grader_errors: i64,
    /// Tasks of its suite.
    pub tasks: i64,
    /// When it was made.
    pub created_at_ms: i64,
    /// When it ended.
    pub finished_at_ms: Option<i64>,
    /// Its summary, once ended.
    pub summary: Option<Summary>,
    /// Who began it; none where the service was open to everybody.
    pub owner: Option<String>,
    /// How its logs came about.
    pub provenance: String,
}

/// A run to store.
#[derive(Debug, Clone, Copy)]
pub struct NewRun<'a> {
    /// Its id.
    pub id: &'a str,
    /// Who builds.
    pub agent: &'a str,
    /// `name@version` of its suite.
    pub suite_id: &'a str,
    /// What its owner says about it.
    pub metadata: &'a serde_json::Value,
    /// Whose key begins it.
    pub owner: Option<&'a str>,
    /// How its logs come about.
    pub provenance: &'a str,
}

/// Columns of a run, for every query that reads one.
macro_rules! select_run {
    ($rest:literal) => {
        concat!(
            "SELECT r.id, r.agent, r.suite_id, r.metadata, r.state, r.pending, r.graded, r.grader_errors,
                    s.task_count, r.created_at_ms, r.finished_at_ms, r.summary, r.owner, r.provenance
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
        state: RunState::read(row.try_get(4)?)?,
        pending: row.try_get(5)?,
        graded: row.try_get(6)?,
        grader_errors: row.try_get(7)?,
        tasks: row.try_get(8)?,
        created_at_ms: row.try_get(9)?,
        finished_at_ms: row.try_get(10)?,
        summary: summary.map(serde_json::from_str).transpose().map_err(corrupt)?,
        owner: row.try_get(12)?,
        provenance: row.try_get(13)?,
    })
}

impl Store {
    /// Stores a new run; where it shall be made once and was made before, gives the id of that one.
    ///
    /// # Errors
    /// Where the database fails.
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

    /// The run with this id.
    ///
    /// # Errors
    /// Where the database fails or the row does not read back.
    pub async fn run(&self, id: &str) -> StoreResult<Option<RunRow>> {
        let row = sqlx::query(select_run!("WHERE r.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read_run).transpose()
    }

    /// Says that no more submissions will come; ends the run where nothing is pending. False where there is no such
    /// run.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn finish_run(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let found = sqlx::query("UPDATE runs SET state = 'finishing' WHERE id = $1 AND state = 'open'")
            .bind(id)
            .execute(&mut *tx)
            .await?
            .rows_affected();
        let Some(run) = run_in(&mut tx, id).await? else { return Ok(false) };
        let has_ended = found > 0 && end_if_complete(&mut tx, id, &run.suite_id, now_ms).await?;
        commit(tx, "finish_run").await?;
        self.note_ends(has_ended);
        Ok(true)
    }
}

/// The run as the transaction sees it.
pub(super) async fn run_in(tx: &mut SqliteConnection, id: &str) -> StoreResult<Option<RunRow>> {
    let row = sqlx::query(select_run!("WHERE r.id = $1")).bind(id).fetch_optional(&mut *tx).await?;
    row.as_ref().map(read_run).transpose()
}

/// Moves a run's counters.
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

/// Ends the run where nothing is left to wait for, with its summary over the tasks of its suite.
pub(super) async fn end_if_complete(
    tx: &mut SqliteConnection,
    id: &str,
    suite_id: &str,
    now_ms: i64,
) -> StoreResult<bool> {
    let Some(run) = run_in(tx, id).await? else { return Ok(false) };
    let is_quiet = run.pending == 0 && run.grader_errors == 0;
    let is_complete = run.state == RunState::Finishing || run.graded >= run.tasks;
    if run.state == RunState::Finished || !is_quiet || !is_complete {
        return Ok(false);
    }
    let tasks = tasks_of(tx, suite_id).await?;
    set_result(tx, id, &tasks, now_ms).await?;
    let ended = NewEvent { run_id: Some(id), submission_id: None, state: RunState::Finished.name(), overall: None };
    events::enter(tx, &[ended], now_ms).await?;
    Ok(true)
}

/// Finishes a run with what its latest reports come to, or changes what a finished one came to.
pub(super) async fn set_result(tx: &mut SqliteConnection, id: &str, tasks: &[Task], now_ms: i64) -> StoreResult<()> {
    let problems = problems_of(tx, id).await?;
    let summary = serde_json::to_string(&summarise(&problems, tasks));
    let summary = summary.map_err(|error| StoreError::corrupt("runs", error))?;
    sqlx::query(
        "UPDATE runs SET state = 'finished', finished_at_ms = COALESCE(finished_at_ms, $2), summary = $3 WHERE id = $1",
    )
    .bind(id)
    .bind(now_ms)
    .bind(&summary)
    .execute(&mut *tx)
    .await?;
    let fingerprint = fingerprint_of(tx, id).await?;
    enter_result(tx, id, &summary, &Outcomes::of(tasks, &problems), &fingerprint, now_ms).await
}

/// What a run built and in which order, over its latest reports.
async fn fingerprint_of(tx: &mut SqliteConnection, id: &str) -> StoreResult<Fingerprint> {
    let parts: Vec<Vec<u8>> = sqlx::query_scalar(
        "SELECT r.fingerprint FROM submissions s JOIN reports r ON r.submission_id = s.id
         WHERE s.run_id = $1 AND s.state = 'graded' AND s.superseded = 0 AND r.fingerprint IS NOT NULL
           AND r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = s.id)",
    )
    .bind(id)
    .fetch_all(tx)
    .await?;
    let mut whole = Fingerprint::default();
    parts.iter().filter_map(|bytes| Fingerprint::from_bytes(bytes)).for_each(|part| whole.merge(&part));
    Ok(whole)
}

/// Scores of a run's reports, the latest of each submission.
pub(super) async fn problems_of(tx: &mut SqliteConnection, id: &str) -> StoreResult<Vec<ProblemScores>> {
    let rows = sqlx::query(
        "SELECT s.task_number, r.scores
         FROM submissions s JOIN reports r ON r.submission_id = s.id
         WHERE s.run_id = $1 AND s.state = 'graded' AND s.superseded = 0
           AND r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = s.id)
         ORDER BY s.task_number",
    )
    .bind(id)
    .fetch_all(&mut *tx)
    .await?;
    let mut problems = Vec::with_capacity(rows.len());
    for row in &rows {
        let scores: ProblemScores =
            serde_json::from_str(row.try_get(1)?).map_err(|error| StoreError::corrupt("reports", error))?;
        problems.push(scores);
    }
    Ok(problems)
}

/// Summary of a run's problems; tasks without one count as failed.
pub(super) fn summarise(problems: &[ProblemScores], tasks: &[Task]) -> Summary {
    let answered: std::collections::HashSet<u32> = problems.iter().map(|problem| problem.number).collect();
    let unanswered: Vec<ProblemScores> = tasks
        .iter()
        .filter(|task| !answered.contains(&task.number))
        .map(|task| ProblemScores {
            number: task.number,
            rows: task.checks().map(|check| (check.criterion(), 0.0)).collect(),
        })
        .collect();
    Summary::with_unanswered(problems, &unanswered)
}
