//! Runs: one agent's attempt at a suite.
//!
//! A run ends by itself when every task of its suite has been graded, or when its owner says that no more will come
//! and nothing is pending. A failure of ours keeps it from ending until the task is posted again.

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
    /// Takes submissions.
    Open,
    /// Takes no more; some are still being graded.
    Finishing,
    /// Ended, with a summary.
    Finished,
    /// Deleted by its owner while it was open.
    Deleted,
}

/// Which runs are listed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunsWanted {
    /// In this state; without one all but deleted ones.
    pub state: Option<RunState>,
    /// Of this suite.
    pub suite_id: Option<String>,
    /// Of agents whose names hold this, in whatever case.
    pub agent: Option<String>,
    /// Of this owner.
    pub owner: Option<String>,
    /// Begun then or after.
    pub since_ms: Option<i64>,
    /// Begun before.
    pub until_ms: Option<i64>,
    /// Begun before this run.
    pub after: Option<String>,
}

/// Which tasks a run leaves out on purpose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Skip {
    /// All that have no submission.
    Unanswered,
    /// Those with these numbers.
    Tasks(Vec<u32>),
}

/// What came of finishing or deleting a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunChanged {
    /// It is so now.
    Done,
    /// There is no such run.
    NoSuchRun,
    /// It is not open any more.
    NotOpen(RunState),
    /// These tasks were answered, and so cannot be skipped.
    Answered(Vec<u32>),
}

impl RunState {
    /// Its name in the API and the database.
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
    /// Tasks that it skips.
    pub skipped: i64,
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

    /// Runs, the latest first, at most `limit`.
    ///
    /// # Errors
    /// Where the database fails or a row does not read back.
    pub async fn runs(&self, wanted: &RunsWanted, limit: i64) -> StoreResult<Vec<RunRow>> {
        let mut query = QueryBuilder::new(select_run!("WHERE "));
        match wanted.state {
            None => query.push("r.deleted_at_ms IS NULL"),
            Some(RunState::Deleted) => query.push("r.deleted_at_ms IS NOT NULL"),
            Some(state) => query.push("r.deleted_at_ms IS NULL AND r.state = ").push_bind(state.name()),
        };
        if let Some(suite) = &wanted.suite_id {
            // A name without version means all of them.
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

    /// Deletes a run that is open: cancels what waits of it, and takes nothing more.
    ///
    /// # Errors
    /// Where the database fails.
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

    /// Says that no more submissions will come, and which tasks are left out on purpose; ends the run where nothing is pending. A run
    /// that is finished, or will be, stays as it is; then nothing can be skipped.
    ///
    /// # Errors
    /// Where the database fails.
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
