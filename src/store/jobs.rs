//! Jobs: submissions that wait to be graded, and the leases under which workers hold them.
//!
//! The attempt number is a fencing token: the result of a worker counts only while the job still has its attempt
//! number. When a lease expires, the job is taken again; after [`MAX_ATTEMPTS`] attempts the submission visibly ends as
//! `grader_error`.

use super::db::{Each, Tx, query, query_as, query_scalar};
use super::job_ends::{End, MAX_ATTEMPTS};
use super::locks::Lock;
use super::postgres::notices::Notice;
use super::states::SubmissionState;
use super::submissions::stored_log;
use super::{Store, StoreError, StoreResult, commit};
use crate::clock::now_ms;
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;

/// Job that a worker holds.
#[derive(Debug, Clone)]
pub struct Claim {
    /// Identifier of the submission to grade.
    pub submission_id: String,
    /// Number of the attempt, which is the fencing token.
    pub attempt: i64,
    /// Identifier of the run that the submission belongs to.
    pub run_id: Option<String>,
    /// `name@version` of the task's suite.
    pub suite_id: String,
    /// Number of the task in the suite.
    pub task_number: u32,
    /// Owner of the submission.
    pub owner: Option<String>,
    /// SHA-256 of the log, in hex.
    pub log_hash: String,
    /// Data of the hidden instance, if the submission answers one; it is still secret.
    pub hidden: Option<HiddenJob>,
    pub(super) log: Vec<u8>,
    /// Why the log is lost, if it was an object that is gone or damaged.
    pub(super) lost: Option<String>,
}

/// Data that grading the answer to a hidden instance needs, because no suite has its task.
#[derive(Debug, Clone)]
pub struct HiddenJob {
    /// Identifier of the instance.
    pub instance_id: String,
    /// Identifier of its epoch.
    pub epoch_id: String,
    /// Time of the answer, in milliseconds since 1970.
    pub answered_at_ms: i64,
    /// Salt of its receipt.
    pub salt: String,
    pub(super) task_hash: String,
    pub(super) task: String,
}

impl HiddenJob {
    /// Returns the task with its hash.
    ///
    /// # Errors
    /// Returns an error if the task cannot be read.
    pub fn read_task(&self) -> StoreResult<(Task, &str)> {
        let task = serde_json::from_str(&self.task).map_err(|error| StoreError::corrupt("tasks", error))?;
        Ok((task, &self.task_hash))
    }
}

impl Claim {
    /// Returns the log.
    ///
    /// # Errors
    /// Returns an error if the stored bytes cannot be read.
    pub fn read_log(&self) -> StoreResult<BlockLog> {
        match &self.lost {
            Some(detail) => Err(StoreError::BlobLost(detail.clone())),
            None => stored_log(&self.log),
        }
    }

    /// Says why the submission could not be read, for its owner and the operator. What names a place stays in the service's
    /// log.
    #[must_use]
    pub const fn why_unreadable(&self) -> &'static str {
        match self.lost {
            Some(_) => {
                "its block log, which is kept outside the database, is lost; the operator's messages name the object"
            }
            None => "the stored submission could not be read",
        }
    }
}

impl Store {
    /// Ends the submission of a job that has no attempts left, unless the job has changed meanwhile.
    pub(super) async fn give_up(&self, submission_id: &str, attempt: i64, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        let (run_id, suite_id, owner, epoch_id): (Option<String>, String, Option<String>, Option<String>) = query_as(
            "SELECT s.run_id, s.suite_id, s.owner, i.epoch_id
             FROM submissions s LEFT JOIN instances i ON i.id = s.instance_id WHERE s.id = $1",
        )
        .bind(submission_id)
        .fetch_one(&mut tx)
        .await?;
        tx.lock(locks_of(run_id.as_deref(), owner.as_deref(), epoch_id.as_deref())).await?;
        if attempt_in(&mut tx, submission_id).await? != Some(attempt) {
            return Ok(());
        }
        let why = format!("grading was begun {MAX_ATTEMPTS} times and never ended");
        let end = End { submission_id, run_id: run_id.as_deref(), state: SubmissionState::GraderError };
        let has_run_ended = end.record(&mut tx, &*self.signer()?, &why, &suite_id, now_ms).await?;
        tx.notify(Notice::Ended { changes_board: has_run_ended }).await?;
        commit(tx, "claim (given up)").await?;
        tracing::error!(submission = submission_id, why, "a submission ended as grader_error");
        self.note_ends(has_run_ended);
        Ok(())
    }

    /// Extends a lease to `lease_ms` from now. Returns false if the job no longer belongs to this attempt.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn renew(&self, claim: &Claim, lease_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let held = query(Each {
            sqlite: "UPDATE jobs SET lease_until_ms = $3 + $4, lease_ms = $4 WHERE submission_id = $1 AND attempt = $2",
            postgres: "UPDATE jobs SET lease_until_ms = now_ms() + $4, lease_ms = $4
                       WHERE submission_id = $1 AND attempt = $2",
        })
        .bind(&claim.submission_id)
        .bind(claim.attempt)
        .bind(now_ms())
        .bind(lease_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "renew").await?;
        Ok(held > 0)
    }

    /// Gives a job back unfinished. The attempt does not count at a shutdown, but does after a failure.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn give_back(&self, claim: &Claim, attempt_counts: bool) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        let held = query(
            "UPDATE jobs SET lease_until_ms = 0, attempt = attempt - $3 WHERE submission_id = $1 AND attempt = $2",
        )
        .bind(&claim.submission_id)
        .bind(claim.attempt)
        .bind(i64::from(!attempt_counts))
        .execute(&mut tx)
        .await?;
        if held > 0 {
            query("UPDATE submissions SET state = 'queued' WHERE id = $1")
                .bind(&claim.submission_id)
                .execute(&mut tx)
                .await?;
        }
        commit(tx, "give_back").await?;
        Ok(())
    }

    /// Cancels a submission that is queued or being graded, on request of its owner. Returns false if it has ended
    /// already.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn cancel(&self, submission_id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let found: Option<(Option<String>, String, Option<String>)> =
            query_as("SELECT run_id, suite_id, owner FROM submissions WHERE id = $1 AND instance_id IS NULL")
                .bind(submission_id)
                .fetch_optional(&mut tx)
                .await?;
        let Some((run_id, suite_id, owner)) = found else { return Ok(false) };
        tx.lock(locks_of(run_id.as_deref(), owner.as_deref(), None)).await?;
        if attempt_in(&mut tx, submission_id).await?.is_none() {
            return Ok(false);
        }
        let end = End { submission_id, run_id: run_id.as_deref(), state: SubmissionState::Cancelled };
        // The job is gone, so a result that a worker still brings back does not count.
        let has_run_ended = end.record(&mut tx, &*self.signer()?, "cancelled by its owner", &suite_id, now_ms).await?;
        tx.notify(Notice::Ended { changes_board: has_run_ended }).await?;
        commit(tx, "cancel").await?;
        self.note_ends(has_run_ended);
        Ok(true)
    }

    /// Counts the jobs ahead of this one in its lane, up to `most`; none if it is not waiting.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn jobs_before(&self, submission_id: &str, most: i64) -> StoreResult<Option<i64>> {
        let place: Option<(i64, i64, String)> =
            query_as("SELECT turn, queued_at_ms, lane FROM jobs WHERE submission_id = $1 AND lease_until_ms = 0")
                .bind(submission_id)
                .fetch_optional(&self.readers)
                .await?;
        let Some((turn, queued_at_ms, lane)) = place else { return Ok(None) };
        let before = query_scalar(
            "SELECT COUNT(*) FROM (SELECT 1 FROM jobs
                                   WHERE lane = $5 AND (turn < $1 OR (turn = $1 AND (queued_at_ms, submission_id) < ($2, $3)))
                                   LIMIT $4) AS b",
        )
        .bind(turn)
        .bind(queued_at_ms)
        .bind(submission_id)
        .bind(most)
        .bind(lane)
        .fetch_one(&self.readers)
        .await?;
        Ok(Some(before))
    }

    /// Ends a submission without a report, if this attempt still holds the job. Returns whether it does.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn fail(&self, claim: &Claim, state: SubmissionState, why: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let mut has_run_ended = false;
        let epoch = claim.hidden.as_ref().map(|hidden| hidden.epoch_id.as_str());
        tx.lock(locks_of(claim.run_id.as_deref(), claim.owner.as_deref(), epoch)).await?;
        let is_held = attempt_in(&mut tx, &claim.submission_id).await? == Some(claim.attempt);
        if is_held {
            let end = End { submission_id: &claim.submission_id, run_id: claim.run_id.as_deref(), state };
            has_run_ended = end.record(&mut tx, &*self.signer()?, why, &claim.suite_id, now_ms).await?;
            tx.notify(Notice::Ended { changes_board: has_run_ended }).await?;
        }
        commit(tx, "fail").await?;
        self.note_ends(has_run_ended);
        Ok(is_held)
    }
}

/// Returns the attempt of a job, and keeps others from taking the job until the transaction ends; none if the job has
/// ended.
pub(super) async fn attempt_in(tx: &mut Tx, submission_id: &str) -> StoreResult<Option<i64>> {
    query_scalar(Each {
        sqlite: "SELECT attempt FROM jobs WHERE submission_id = $1",
        postgres: "SELECT attempt FROM jobs WHERE submission_id = $1 FOR UPDATE",
    })
    .bind(submission_id)
    .fetch_optional(tx)
    .await
}

/// Returns the locks that ending a submission takes.
pub(super) fn locks_of<'a>(
    run_id: Option<&'a str>,
    owner: Option<&'a str>,
    epoch_id: Option<&'a str>,
) -> impl Iterator<Item = Lock<'a>> {
    [epoch_id.map(Lock::Epoch), run_id.map(Lock::Run), Some(Lock::Owner(owner.unwrap_or_default()))]
        .into_iter()
        .flatten()
}
