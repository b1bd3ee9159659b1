//! Failures of ours: submissions that ended as `grader_error`, and how they are graded after all.
//!
//! What is graded again is a copy of the submission, which supersedes it: the end of the first was told to its owner
//! and, if it answers a hidden instance, is witnessed. A worker that still holds an attempt of the first cannot record
//! anything on the copy.

use super::acceptance::supersede;
use super::db::{Tx, query, query_as};
use super::jobs::locks_of;
use super::postgres::notices::Notice;
use super::queue::{self, Lane, NewJob};
use super::quota;
use super::rows::from_row;
use super::run_rows::count;
use super::states::{RunState, SubmissionState};
use super::{Store, StoreResult, commit};

/// Submission that ended as `grader_error` and can still be graded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FailureRow {
    /// Identifier of the submission.
    pub id: String,
    /// Owner of the submission; none if the service was open to everybody.
    pub owner: Option<String>,
    /// Identifier of the run that the submission belongs to.
    pub run_id: Option<String>,
    /// Identifier of the hidden instance that the submission answers.
    pub instance_id: Option<String>,
    /// `name@version` of the task's suite.
    pub suite_id: String,
    /// Number of the task in the suite.
    pub task_number: u32,
    /// Reason for the end.
    pub error: Option<String>,
    /// Time of the end, in milliseconds since 1970.
    pub ended_at_ms: i64,
}

from_row!(FailureRow { id, owner, run_id, instance_id, suite_id, task_number, error, ended_at_ms });

/// Reason why a submission is not graded again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RetryRefusal {
    /// There is no such submission.
    Unknown,
    /// The submission is in another state.
    NotFailed(SubmissionState),
    /// The submission was posted or queued again already, under this identifier if it is known, or its run skips the task.
    Superseded(Option<String>),
    /// The run is in this state and takes no more grades.
    RunOver(RunState),
    /// The entry of the hidden instance is complete: its result may have been revealed.
    EntryComplete,
}

/// A failed submission and what it belongs to.
struct Failed {
    id: String,
    state: SubmissionState,
    superseded: bool,
    superseded_by: Option<String>,
    owner: Option<String>,
    run_id: Option<String>,
    run_state: Option<RunState>,
    instance_id: Option<String>,
    epoch_id: Option<String>,
    completed_at_ms: Option<i64>,
}

from_row!(Failed {
    id,
    state,
    superseded,
    superseded_by,
    owner,
    run_id,
    run_state,
    instance_id,
    epoch_id,
    completed_at_ms
});

impl Failed {
    async fn read(tx: &mut Tx, id: &str) -> StoreResult<Option<Self>> {
        query_as(
            "SELECT s.id, s.state, s.superseded, s.superseded_by, s.owner, s.run_id, s.instance_id, i.epoch_id, e.completed_at_ms,
                    CASE WHEN r.deleted_at_ms IS NULL THEN r.state ELSE 'deleted' END AS run_state
             FROM submissions s LEFT JOIN runs r ON r.id = s.run_id
                  LEFT JOIN instances i ON i.id = s.instance_id LEFT JOIN entries e ON e.id = i.entry_id
             WHERE s.id = $1",
        )
        .bind(id)
        .fetch_optional(tx)
        .await
    }

    /// Returns why the submission is not graded again, if it is not.
    fn refusal(&self) -> Option<RetryRefusal> {
        if self.state != SubmissionState::GraderError {
            return Some(RetryRefusal::NotFailed(self.state));
        }
        if self.superseded {
            return Some(RetryRefusal::Superseded(self.superseded_by.clone()));
        }
        if let Some(state @ (RunState::Finished | RunState::Deleted)) = self.run_state {
            return Some(RetryRefusal::RunOver(state));
        }
        self.completed_at_ms.map(|_| RetryRefusal::EntryComplete)
    }

    /// Stores a copy with this identifier in the place of the submission, with its job and its reservation. A clock that is
    /// behind dates it no earlier than the submission.
    async fn replace(&self, tx: &mut Tx, copy: &str, now_ms: i64) -> StoreResult<()> {
        supersede(tx, &self.id, copy).await?;
        query(
            "INSERT INTO submissions (id, run_id, suite_id, task_hash, task_number, log_hash, log, log_bytes, turns, events,
                                      state, created_at_ms, owner, replays, profile, instance_id)
             SELECT $2, run_id, suite_id, task_hash, task_number, log_hash, log, log_bytes, turns, events,
                    $3, CASE WHEN created_at_ms > $4 THEN created_at_ms ELSE $4 END, owner, replays, profile, instance_id
             FROM submissions WHERE id = $1",
        )
        .bind(&self.id)
        .bind(copy)
        .bind(SubmissionState::Queued)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        query("UPDATE episodes SET submission_id = $2 WHERE submission_id = $1")
            .bind(&self.id)
            .bind(copy)
            .execute(&mut *tx)
            .await?;
        if let Some(run) = &self.run_id {
            count(tx, run, 1, 0, -1).await?;
        }
        let lane = if self.instance_id.is_some() { Lane::Hidden } else { Lane::Long };
        let owner = self.owner.as_deref().unwrap_or_default();
        queue::enter(tx, lane, owner, &[NewJob { submission_id: copy }], now_ms).await?;
        match (&self.owner, &self.instance_id) {
            (Some(owner), None) => quota::reserve(tx, &[(owner, copy)], now_ms).await,
            (None, None) => Ok(()),
            // The reservation for a hidden instance is held until its entry is complete.
            (_, Some(_)) => quota::hand_over(tx, &self.id, copy).await,
        }
    }
}

impl Store {
    /// Returns the submissions that ended as `grader_error` and can still be graded, the oldest end first. Those whose log
    /// their owner posted again without a run are left out.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn failures(&self) -> StoreResult<Vec<FailureRow>> {
        query_as(
            "SELECT s.id, s.owner, s.run_id, s.instance_id, s.suite_id, s.task_number, s.error, s.ended_at_ms
             FROM submissions s LEFT JOIN runs r ON r.id = s.run_id
                  LEFT JOIN instances i ON i.id = s.instance_id LEFT JOIN entries e ON e.id = i.entry_id
             WHERE s.state = 'grader_error' AND s.superseded = FALSE AND r.deleted_at_ms IS NULL
               AND e.completed_at_ms IS NULL
               AND NOT (s.run_id IS NULL AND s.instance_id IS NULL
                        AND EXISTS (SELECT 1 FROM submissions a
                                    WHERE a.log_hash = s.log_hash AND a.task_hash = s.task_hash AND a.run_id IS NULL
                                      AND a.instance_id IS NULL AND COALESCE(a.owner, '') = COALESCE(s.owner, '')
                                      AND a.id > s.id))
             ORDER BY s.ended_at_ms, s.id",
        )
        .fetch_all(&self.readers)
        .await
    }

    /// Queues a copy of a submission that ended as `grader_error`, under the identifier `copy`. It supersedes the
    /// submission, and its owner is charged for it as for any other.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing changes.
    pub async fn grade_after_failure(
        &self,
        id: &str,
        copy: &str,
        now_ms: i64,
    ) -> StoreResult<Result<(), RetryRefusal>> {
        let mut tx = self.begin().await?;
        let Some(seen) = Failed::read(&mut tx, id).await? else { return Ok(Err(RetryRefusal::Unknown)) };
        tx.lock(locks_of(seen.run_id.as_deref(), seen.owner.as_deref(), seen.epoch_id.as_deref())).await?;
        // Once more, now that nobody else changes it.
        let Some(failed) = Failed::read(&mut tx, id).await? else { return Ok(Err(RetryRefusal::Unknown)) };
        if let Some(refusal) = failed.refusal() {
            return Ok(Err(refusal));
        }
        failed.replace(&mut tx, copy, now_ms).await?;
        tx.notify(Notice::Queued).await?;
        commit(tx, "grade_after_failure").await?;
        self.queued.notify_waiters();
        Ok(Ok(()))
    }
}
