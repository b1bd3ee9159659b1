//! Jobs: submissions that wait for a grade, and the leases under which workers hold them.
//!
//! The attempt number fences: what a worker brings back counts only while its attempt is the job's. A lease that runs
//! out is taken again; after [`MAX_ATTEMPTS`] the submission ends as `grader_error`, visibly.

use std::collections::HashMap;

use sqlx::{QueryBuilder, Row as _, Sqlite, SqliteConnection};

use super::events::{self, NewEvent};
use super::quota;
use super::run_ends::end_if_complete;
use super::runs::count;
use super::submissions::SubmissionState;
use super::{Store, StoreError, StoreResult, commit, decompress};
use crate::clock::now_ms;
use crate::tasks::Task;
use crate::voxel::BlockLog;

/// Attempts before a submission ends as `grader_error`.
pub const MAX_ATTEMPTS: i64 = 3;

/// A job that a worker holds.
#[derive(Debug, Clone)]
pub struct Claim {
    /// The submission to grade.
    pub submission_id: String,
    /// The fencing token.
    pub attempt: i64,
    /// The run it belongs to.
    pub run_id: Option<String>,
    /// `name@version` of the task's suite.
    pub suite_id: String,
    /// Number of the task in it.
    pub task_number: u32,
    /// Who posted it.
    pub owner: Option<String>,
    /// Hash of its log.
    pub log_hash: String,
    /// Of an answer to a hidden instance: what nobody is shown yet.
    pub hidden: Option<HiddenJob>,
    log: Vec<u8>,
}

/// What a job needs beside the suites' tasks to grade the answer to a hidden instance.
#[derive(Debug, Clone)]
pub struct HiddenJob {
    /// The instance.
    pub instance_id: String,
    /// Its epoch.
    pub epoch_id: String,
    /// Salt of its receipt.
    pub salt: String,
    task_hash: String,
    task: String,
}

impl HiddenJob {
    /// The task with its hash.
    ///
    /// # Errors
    /// Where it does not read back.
    pub fn read_task(&self) -> StoreResult<(Task, &str)> {
        let task = serde_json::from_str(&self.task).map_err(|error| StoreError::corrupt("tasks", error))?;
        Ok((task, &self.task_hash))
    }
}

impl Claim {
    /// The log.
    ///
    /// # Errors
    /// Where the stored bytes do not read back.
    pub fn read_log(&self) -> StoreResult<BlockLog> {
        let json = decompress("submissions", &self.log)?;
        BlockLog::from_canonical_json(&json).map_err(|error| StoreError::corrupt("submissions", error))
    }
}

/// What came of looking for work.
#[derive(Debug)]
pub enum Claimed {
    /// Jobs to do: one, or several that are quick.
    Jobs(Vec<Claim>),
    /// A job whose attempts were used up; its submission ended as `grader_error`. There may be more work.
    GivenUp,
    /// Nothing to do now.
    Nothing,
}

impl Store {
    /// Takes the job whose turn it is, of those that are free or whose lease has run out, under a lease of `lease_ms` from the moment that
    /// this transaction has the database to itself. Where it is quick and was never begun, up to `most` such jobs come
    /// with it; one that was begun before comes alone, so that what ails it befalls no other.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn claim(&self, lease_ms: i64, most: usize) -> StoreResult<Claimed> {
        let mut tx = self.begin().await?;
        let now_ms = now_ms();
        let first: Option<(String, i64, bool)> = sqlx::query_as(
            "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
             WHERE submission_id = (SELECT submission_id FROM jobs
                                    WHERE lease_until_ms <= $1 OR lease_until_ms - lease_ms > $1
                                    ORDER BY turn, queued_at_ms, submission_id LIMIT 1)
             RETURNING submission_id, attempt, quick",
        )
        .bind(now_ms)
        .bind(lease_ms)
        .fetch_optional(&mut *tx)
        .await?;
        let Some((id, attempt, quick)) = first else { return Ok(Claimed::Nothing) };
        if attempt > MAX_ATTEMPTS {
            let has_ended = give_up(&mut tx, &id, now_ms).await?;
            commit(tx, "claim (given up)").await?;
            self.note_ends(has_ended);
            return Ok(Claimed::GivenUp);
        }
        let mut taken = vec![(id, attempt)];
        if quick && attempt == 1 {
            let more: Vec<(String, i64)> = sqlx::query_as(
                "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
                 WHERE submission_id IN (SELECT submission_id FROM jobs
                                         WHERE lease_until_ms <= $1 AND quick = 1 AND attempt = 0
                                         ORDER BY turn, queued_at_ms, submission_id LIMIT $3)
                 RETURNING submission_id, attempt",
            )
            .bind(now_ms)
            .bind(lease_ms)
            .bind(most.saturating_sub(1) as i64)
            .fetch_all(&mut *tx)
            .await?;
            taken.extend(more);
        }
        let mut update = QueryBuilder::new("UPDATE submissions SET state = 'grading' WHERE id IN ");
        push_ids(&mut update, taken.iter().map(|(id, _)| id.as_str()));
        update.build().execute(&mut *tx).await?;
        let mut select = QueryBuilder::new(
            "SELECT s.id, s.run_id, s.suite_id, s.task_number, s.log, s.owner, s.log_hash, i.id, i.epoch_id, i.salt,
                    i.task_hash, CASE WHEN i.id IS NULL THEN NULL ELSE t.body END
             FROM submissions s LEFT JOIN instances i ON i.id = s.instance_id LEFT JOIN tasks t ON t.hash = i.task_hash
             WHERE s.id IN ",
        );
        push_ids(&mut select, taken.iter().map(|(id, _)| id.as_str()));
        let rows = select.build().fetch_all(&mut *tx).await?;
        commit(tx, "claim").await?;
        let attempts: HashMap<String, i64> = taken.into_iter().collect();
        let mut claims = Vec::with_capacity(rows.len());
        for row in rows {
            let submission_id: String = row.try_get(0)?;
            claims.push(Claim {
                attempt: attempts.get(&submission_id).copied().unwrap_or_default(),
                submission_id,
                run_id: row.try_get(1)?,
                suite_id: row.try_get(2)?,
                task_number: u32::try_from(row.try_get::<i64, _>(3)?).unwrap_or_default(),
                log: row.try_get(4)?,
                owner: row.try_get(5)?,
                log_hash: row.try_get(6)?,
                hidden: match row.try_get::<Option<String>, _>(7)? {
                    None => None,
                    Some(instance_id) => Some(HiddenJob {
                        instance_id,
                        epoch_id: row.try_get(8)?,
                        salt: row.try_get(9)?,
                        task_hash: row.try_get(10)?,
                        task: row.try_get(11)?,
                    }),
                },
            });
        }
        Ok(Claimed::Jobs(claims))
    }

    /// Extends a lease to `lease_ms` from now. False where the job is no longer this attempt's.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn renew(&self, claim: &Claim, lease_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let held =
            sqlx::query("UPDATE jobs SET lease_until_ms = $3, lease_ms = $4 WHERE submission_id = $1 AND attempt = $2")
                .bind(&claim.submission_id)
                .bind(claim.attempt)
                .bind(now_ms() + lease_ms)
                .bind(lease_ms)
                .execute(&mut *tx)
                .await?
                .rows_affected();
        commit(tx, "renew").await?;
        Ok(held > 0)
    }

    /// Gives a job back unfinished: at a shutdown the attempt does not count, after a failure it does.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn give_back(&self, claim: &Claim, attempt_counts: bool) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        let held = sqlx::query(
            "UPDATE jobs SET lease_until_ms = 0, attempt = attempt - $3 WHERE submission_id = $1 AND attempt = $2",
        )
        .bind(&claim.submission_id)
        .bind(claim.attempt)
        .bind(i64::from(!attempt_counts))
        .execute(&mut *tx)
        .await?
        .rows_affected();
        if held > 0 {
            sqlx::query("UPDATE submissions SET state = 'queued' WHERE id = $1")
                .bind(&claim.submission_id)
                .execute(&mut *tx)
                .await?;
        }
        commit(tx, "give_back").await?;
        Ok(())
    }

    /// Ends a submission that waits or is being graded, because its owner says so. False where it has ended already.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn cancel(&self, submission_id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let found: Option<(Option<String>, String)> = sqlx::query_as(
            "SELECT s.run_id, s.suite_id FROM submissions s JOIN jobs j ON j.submission_id = s.id
             WHERE s.id = $1 AND s.instance_id IS NULL",
        )
        .bind(submission_id)
        .fetch_optional(&mut *tx)
        .await?;
        let Some((run_id, suite_id)) = found else { return Ok(false) };
        let end = End { submission_id, run_id: run_id.as_deref(), state: SubmissionState::Cancelled };
        // The job is gone: what a worker brings back of it no longer counts.
        let has_ended = end.record(&mut tx, Some("cancelled by its owner"), &suite_id, now_ms).await?;
        commit(tx, "cancel").await?;
        self.note_ends(has_ended);
        Ok(true)
    }

    /// How many jobs come before this one, up to `most`; none where it does not wait.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn jobs_before(&self, submission_id: &str, most: i64) -> StoreResult<Option<i64>> {
        let place: Option<(i64, i64)> =
            sqlx::query_as("SELECT turn, queued_at_ms FROM jobs WHERE submission_id = $1 AND lease_until_ms = 0")
                .bind(submission_id)
                .fetch_optional(&self.readers)
                .await?;
        let Some((turn, queued_at_ms)) = place else { return Ok(None) };
        let before = sqlx::query_scalar(
            "SELECT COUNT(*) FROM (SELECT 1 FROM jobs
                                   WHERE turn < $1 OR (turn = $1 AND (queued_at_ms, submission_id) < ($2, $3)) LIMIT $4) AS b",
        )
        .bind(turn)
        .bind(queued_at_ms)
        .bind(submission_id)
        .bind(most)
        .fetch_one(&self.readers)
        .await?;
        Ok(Some(before))
    }

    /// Ends a submission without a report, if this attempt still holds it.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn fail(&self, claim: &Claim, state: SubmissionState, why: &str, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        let mut has_ended = false;
        if holds(&mut tx, claim).await? {
            let end = End { submission_id: &claim.submission_id, run_id: claim.run_id.as_deref(), state };
            has_ended = end.record(&mut tx, Some(why), &claim.suite_id, now_ms).await?;
        }
        commit(tx, "fail").await?;
        self.note_ends(has_ended);
        Ok(())
    }
}

/// Adds `(id, id, …)` as bound values.
pub(super) fn push_ids<'a>(query: &mut QueryBuilder<Sqlite>, ids: impl Iterator<Item = &'a str>) {
    query.push("(");
    let mut list = query.separated(", ");
    for id in ids {
        list.push_bind(id.to_owned());
    }
    query.push(")");
}

/// Ends the submission of a job whose attempts are used up.
async fn give_up(tx: &mut SqliteConnection, submission_id: &str, now_ms: i64) -> StoreResult<bool> {
    let (run_id, suite_id): (Option<String>, String) =
        sqlx::query_as("SELECT run_id, suite_id FROM submissions WHERE id = $1")
            .bind(submission_id)
            .fetch_one(&mut *tx)
            .await?;
    let why = format!("grading was begun {MAX_ATTEMPTS} times and never ended");
    let end = End { submission_id, run_id: run_id.as_deref(), state: SubmissionState::GraderError };
    end.record(tx, Some(&why), &suite_id, now_ms).await
}

/// Whether the job is still this attempt's.
pub(super) async fn holds(tx: &mut SqliteConnection, claim: &Claim) -> StoreResult<bool> {
    let attempt: Option<i64> = sqlx::query_scalar("SELECT attempt FROM jobs WHERE submission_id = $1")
        .bind(&claim.submission_id)
        .fetch_optional(&mut *tx)
        .await?;
    Ok(attempt == Some(claim.attempt))
}

/// The end of a submission without a report.
pub(super) struct End<'a> {
    pub submission_id: &'a str,
    pub run_id: Option<&'a str>,
    pub state: SubmissionState,
}

impl End<'_> {
    /// Sets the state, drops the job, moves the run's counters, and ends the run where this was the last;
    /// whether it did.
    pub async fn record(
        &self,
        tx: &mut SqliteConnection,
        why: Option<&str>,
        suite_id: &str,
        now_ms: i64,
    ) -> StoreResult<bool> {
        let (owner, instance): (Option<String>, Option<String>) = sqlx::query_as(
            "UPDATE submissions SET state = $2, error = $3, ended_at_ms = $4 WHERE id = $1 RETURNING owner, instance_id",
        )
        .bind(self.submission_id)
        .bind(self.state.name())
        .bind(why)
        .bind(now_ms)
        .fetch_one(&mut *tx)
        .await?;
        // Of hidden instances the ledger is settled when their entry ends.
        if let Some(owner) = owner.filter(|_| instance.is_none()) {
            quota::refund(tx, &owner, self.submission_id, why.unwrap_or(self.state.name()), now_ms).await?;
        }
        let ended = NewEvent {
            run_id: self.run_id,
            submission_id: Some(self.submission_id),
            state: self.state.name(),
            overall: None,
        };
        // Of hidden instances nobody is told.
        if instance.is_none() {
            events::enter(tx, &[ended], now_ms).await?;
        }
        sqlx::query("DELETE FROM jobs WHERE submission_id = $1").bind(self.submission_id).execute(&mut *tx).await?;
        if let Some(run_id) = self.run_id {
            let errors = i64::from(self.state == SubmissionState::GraderError);
            count(tx, run_id, -1, 0, errors).await?;
            return end_if_complete(tx, run_id, suite_id, now_ms).await;
        }
        Ok(false)
    }
}
