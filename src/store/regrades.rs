//! Regrades: computed alongside the results in force, reviewed, then applied or discarded as a whole.

use super::board_actions::enter_action;
use super::db::{Builder, query, query_as, query_scalar};
use super::locks::Lock;
use super::postgres::notices::Notice;
use super::reports::{GRADER, PackedReport};
use super::results::problems_of;
use super::rows::from_row;
use super::run_ends::set_result;
use super::states::RegradeState;
use super::submissions::stored_log;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::checks::CHECKS_VERSION;
use plumbline_engine::grading::ProblemScores;
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;

/// Row of a regrade.
#[derive(Debug, Clone)]
pub struct RegradeRow {
    /// Identifier of the regrade.
    pub id: String,
    /// `name@version` of the suite.
    pub suite_id: String,
    /// Reason for the regrade.
    pub reason: String,
    /// Name of the person who began it.
    pub actor: String,
    /// Version of the checks that it grades with.
    pub checks_version: i64,
    /// State of the regrade.
    pub state: RegradeState,
    /// Time at which it was begun, in milliseconds since 1970.
    pub created_at_ms: i64,
}

from_row!(RegradeRow { id, suite_id, reason, actor, checks_version, state, created_at_ms });

/// Graded submission that is to be graded again.
#[derive(Debug)]
pub struct ToRegrade {
    /// Identifier of the submission.
    pub submission_id: String,
    /// Number of the task.
    pub task_number: u32,
    log: Vec<u8>,
}

impl ToRegrade {
    /// Returns the log.
    ///
    /// # Errors
    /// Returns an error if the stored bytes cannot be read.
    pub fn read_log(&self) -> StoreResult<BlockLog> {
        stored_log(&self.log)
    }
}

/// Submission whose scores change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Identifier of the submission.
    pub submission_id: String,
    /// Identifier of its run.
    pub run_id: Option<String>,
    /// Number of the task.
    pub task_number: u32,
    /// Verdict in force.
    pub before: bool,
    /// Verdict of the regrade.
    pub after: bool,
}

from_row!(Difference { submission_id, run_id, task_number, before, after });

impl Store {
    /// Begins a regrade.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn begin_regrade(
        &self,
        id: &str,
        suite_id: &str,
        reason: &str,
        actor: &str,
        now_ms: i64,
    ) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query(
            "INSERT INTO regrades (id, suite_id, reason, actor, checks_version, grader, state, created_at_ms)
             VALUES ($1, $2, $3, $4, $5, $6, 'computing', $7)",
        )
        .bind(id)
        .bind(suite_id)
        .bind(reason)
        .bind(actor)
        .bind(i64::from(CHECKS_VERSION))
        .bind(GRADER)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "begin_regrade").await
    }

    /// Returns all regrades, latest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn regrades(&self) -> StoreResult<Vec<RegradeRow>> {
        query_as(
            "SELECT id, suite_id, reason, actor, checks_version, state, created_at_ms FROM regrades
             ORDER BY created_at_ms DESC, id",
        )
        .fetch_all(&self.readers)
        .await
    }

    /// Returns at most `limit` graded submissions of a suite after the one with identifier `after`, in order of
    /// identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn to_regrade(&self, suite_id: &str, after: &str, limit: i64) -> StoreResult<Vec<ToRegrade>> {
        let rows = query(
            "SELECT id, task_number, log FROM submissions
             WHERE id > $2 AND suite_id = $1 AND state = 'graded' ORDER BY id LIMIT $3",
        )
        .bind(suite_id)
        .bind(after)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let mut all = Vec::with_capacity(rows.len());
        for row in &rows {
            let log = self.blobs.fetch(&self.readers, row.get("log")?).await?;
            all.push(ToRegrade { submission_id: row.get("id")?, task_number: row.get("task_number")?, log });
        }
        Ok(all)
    }

    /// Stores reports of a regrade, alongside the reports in force. Returns false, and stores nothing, if the regrade is
    /// no longer computing.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn put_regraded(&self, regrade_id: &str, mut graded: Vec<(String, PackedReport)>) -> StoreResult<bool> {
        self.keep_reports(graded.iter_mut().map(|(_, report)| report)).await?;
        let mut tx = self.begin().await?;
        tx.lock([Lock::Boards]).await?;
        let state: Option<RegradeState> =
            query_scalar("SELECT state FROM regrades WHERE id = $1").bind(regrade_id).fetch_optional(&mut tx).await?;
        if state != Some(RegradeState::Computing) {
            return Ok(false);
        }
        let mut query = Builder::new(
            "INSERT INTO regraded (regrade_id, submission_id, overall, accuracy, scores, body, grading_us) ",
        );
        query.push_values(&graded, |row, (submission_id, report)| {
            row.push_bind(regrade_id.to_owned()).push_bind(submission_id.clone());
            report.push_to(row);
        });
        query.build().execute(&mut tx).await?;
        commit(tx, "put_regraded").await?;
        Ok(true)
    }

    /// Marks a regrade as ready. Returns false if it is not being computed.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn mark_ready(&self, id: &str) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Boards]).await?;
        let ready = "UPDATE regrades SET state = 'ready' WHERE id = $1 AND state = 'computing'";
        let found = query(ready).bind(id).execute(&mut tx).await?;
        commit(tx, "mark_ready").await?;
        Ok(found > 0)
    }

    /// Discards a regrade with all its reports. Returns false if it was applied or discarded before.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn discard(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Boards]).await?;
        let discarded = "UPDATE regrades SET state = 'discarded', ended_at_ms = $2 WHERE id = $1 AND state IN ('computing', 'ready')";
        let found = query(discarded).bind(id).bind(now_ms).execute(&mut tx).await?;
        if found > 0 {
            query("DELETE FROM regraded WHERE regrade_id = $1").bind(id).execute(&mut tx).await?;
        }
        commit(tx, "discard").await?;
        Ok(found > 0)
    }

    /// Counts the graded submissions of its suite that a regrade has left out, because other checks graded them
    /// meanwhile.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn left_out(&self, id: &str) -> StoreResult<i64> {
        query_scalar(
            "SELECT COUNT(*) FROM regrades q JOIN submissions s ON s.suite_id = q.suite_id AND s.state = 'graded'
             JOIN latest_reports r ON r.submission_id = s.id
             WHERE q.id = $1 AND r.checks_version <> q.checks_version
               AND NOT EXISTS (SELECT 1 FROM regraded g WHERE g.regrade_id = q.id AND g.submission_id = s.id)",
        )
        .bind(id)
        .fetch_one(&self.readers)
        .await
    }

    /// Returns the submissions whose scores the regrade changes.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn differences(&self, id: &str) -> StoreResult<Vec<Difference>> {
        query_as(
            "SELECT g.submission_id, s.run_id, s.task_number, r.overall AS before, g.overall AS after
             FROM regraded g JOIN submissions s ON s.id = g.submission_id
             JOIN latest_reports r ON r.submission_id = g.submission_id
             WHERE g.regrade_id = $1 AND g.scores <> r.scores ORDER BY s.task_number, g.submission_id",
        )
        .bind(id)
        .fetch_all(&self.readers)
        .await
    }

    /// Returns the scores of a run as they would be after the regrade.
    ///
    /// # Errors
    /// Returns an error if the database fails or scores cannot be read.
    pub async fn regraded_problems(&self, id: &str, run_id: &str) -> StoreResult<Vec<ProblemScores>> {
        let mut connection = self.readers.begin_reading().await?;
        let mut problems = problems_of(&mut connection, run_id).await?;
        let rows: Vec<(String,)> = query_as(
            "SELECT g.scores FROM regraded g JOIN submissions s ON s.id = g.submission_id
             WHERE g.regrade_id = $1 AND s.run_id = $2 AND s.superseded = FALSE",
        )
        .bind(id)
        .bind(run_id)
        .fetch_all(&mut connection)
        .await?;
        for (scores,) in rows {
            let scores: ProblemScores =
                serde_json::from_str(&scores).map_err(|error| StoreError::corrupt("regraded", error))?;
            if let Some(problem) = problems.iter_mut().find(|problem| problem.number == scores.number) {
                *problem = scores;
            }
        }
        Ok(problems)
    }

    /// Applies a regrade in one transaction: adds new reports next to the old ones where scores change, new results of
    /// the finished runs that they belong to, and a public action for each of these runs. Returns the number of runs;
    /// none if the regrade is not ready.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is changed.
    pub async fn apply_regrade(&self, id: &str, tasks: &[Task], now_ms: i64) -> StoreResult<Option<usize>> {
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        // A run that ends meanwhile is either among those below or waits until the new reports are there.
        tx.lock([Lock::Boards, Lock::Order]).await?;
        let found: Option<(String, String)> =
            query_as("SELECT reason, actor FROM regrades WHERE id = $1 AND state = 'ready'")
                .bind(id)
                .fetch_optional(&mut tx)
                .await?;
        let Some((reason, actor)) = found else { return Ok(None) };
        let runs: Vec<String> = query_scalar(
            "SELECT DISTINCT u.id FROM regraded g JOIN submissions s ON s.id = g.submission_id
             JOIN runs u ON u.id = s.run_id AND u.state = 'finished'
             JOIN latest_reports r ON r.submission_id = g.submission_id
             WHERE g.regrade_id = $1 AND s.superseded = FALSE AND g.scores <> r.scores ORDER BY u.id",
        )
        .bind(id)
        .fetch_all(&mut tx)
        .await?;
        query(
            "INSERT INTO reports (submission_id, attempt, checks_version, grader, overall, accuracy, scores, body,
                                  graded_at_ms, grading_us, fingerprint)
             SELECT g.submission_id,
                    (SELECT MAX(l.attempt) + 1 FROM reports l WHERE l.submission_id = g.submission_id),
                    q.checks_version, q.grader, g.overall, g.accuracy, g.scores, g.body, $2, g.grading_us,
                    r.fingerprint
             FROM regraded g JOIN regrades q ON q.id = g.regrade_id
             JOIN latest_reports r ON r.submission_id = g.submission_id
             WHERE g.regrade_id = $1 AND g.scores <> r.scores",
        )
        .bind(id)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        for run_id in &runs {
            set_result(&mut tx, run_id, tasks, now_ms).await?;
            enter_action(&mut tx, &signer, run_id, "regrade", &actor, &reason, now_ms).await?;
        }
        query("UPDATE regrades SET state = 'applied', ended_at_ms = $2 WHERE id = $1")
            .bind(id)
            .bind(now_ms)
            .execute(&mut tx)
            .await?;
        query("DELETE FROM regraded WHERE regrade_id = $1").bind(id).execute(&mut tx).await?;
        tx.notify(Notice::Ended { changes_board: true }).await?;
        commit(tx, "apply_regrade").await?;
        self.note_ends(true);
        Ok(Some(runs.len()))
    }
}
