//! Jobs: submissions that wait for a grade, and the leases under which workers hold them.
//!
//! The attempt number fences: what a worker brings back counts only while its attempt is the job's. A lease that runs
//! out is taken again; after [`MAX_ATTEMPTS`] the submission ends as `grader_error`, visibly.

use std::collections::HashMap;

use sqlx::{QueryBuilder, Row as _, Sqlite, SqliteConnection};

use super::job_ends::{End, give_up};
use super::queue::{Lane, note_taken};
use super::submissions::SubmissionState;
use super::{Store, StoreError, StoreResult, commit, decompress};
use crate::clock::now_ms;
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;

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
    /// Takes the job whose turn it is, of those that are free or whose lease has run out, from the first of these lanes that has one,
    /// under a lease of `lease_ms` from the moment that this transaction has the database to itself. Where it is quick and was never
    /// begun, up to `most` such jobs come with it; one that was begun before comes alone, so that what ails it befalls no other.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn claim(&self, lanes: &[Lane], lease_ms: i64, most: usize) -> StoreResult<Claimed> {
        if !self.has_jobs(lanes).await? {
            return Ok(Claimed::Nothing);
        }
        let mut tx = self.begin().await?;
        let now_ms = now_ms();
        let mut first = None;
        for lane in lanes {
            first = take_first(&mut tx, *lane, lease_ms, now_ms).await?.map(|taken| (*lane, taken));
            if first.is_some() {
                break;
            }
        }
        let Some((lane, Taken { id, attempt, turn })) = first else { return Ok(Claimed::Nothing) };
        note_taken(&mut tx, lane, turn).await?;
        if attempt > MAX_ATTEMPTS {
            let has_ended = give_up(&mut tx, &*self.signer()?, &id, now_ms).await?;
            commit(tx, "claim (given up)").await?;
            self.note_ends(has_ended);
            return Ok(Claimed::GivenUp);
        }
        let mut taken = vec![(id, attempt)];
        if lane == Lane::Quick && attempt == 1 {
            let more: Vec<(String, i64, i64)> = sqlx::query_as(
                "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
                 WHERE submission_id IN (SELECT submission_id FROM jobs
                                         WHERE lane = 'quick' AND lease_until_ms <= $1 AND attempt = 0
                                         ORDER BY turn, queued_at_ms, submission_id LIMIT $3)
                 RETURNING submission_id, attempt, turn",
            )
            .bind(now_ms)
            .bind(lease_ms)
            .bind(most.saturating_sub(1) as i64)
            .fetch_all(&mut *tx)
            .await?;
            if let Some(turn) = more.iter().map(|(_, _, turn)| *turn).max() {
                note_taken(&mut tx, lane, turn).await?;
            }
            taken.extend(more.into_iter().map(|(id, attempt, _)| (id, attempt)));
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
        let has_ended = end.record(&mut tx, &*self.signer()?, "cancelled by its owner", &suite_id, now_ms).await?;
        commit(tx, "cancel").await?;
        self.note_ends(has_ended);
        Ok(true)
    }

    /// Whether a lane has jobs at all, free or not: most looks find none, and need not wait for whoever writes.
    async fn has_jobs(&self, lanes: &[Lane]) -> StoreResult<bool> {
        for lane in lanes {
            let has_one: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM jobs WHERE lane = $1)")
                .bind(lane.name())
                .fetch_one(&self.readers)
                .await?;
            if has_one {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// How many jobs come before this one in its lane, up to `most`; none where it does not wait.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn jobs_before(&self, submission_id: &str, most: i64) -> StoreResult<Option<i64>> {
        let place: Option<(i64, i64, String)> =
            sqlx::query_as("SELECT turn, queued_at_ms, lane FROM jobs WHERE submission_id = $1 AND lease_until_ms = 0")
                .bind(submission_id)
                .fetch_optional(&self.readers)
                .await?;
        let Some((turn, queued_at_ms, lane)) = place else { return Ok(None) };
        let before = sqlx::query_scalar(
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

    /// Ends a submission without a report, if this attempt still holds it.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn fail(&self, claim: &Claim, state: SubmissionState, why: &str, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        let mut has_ended = false;
        if holds(&mut tx, claim).await? {
            let end = End { submission_id: &claim.submission_id, run_id: claim.run_id.as_deref(), state };
            has_ended = end.record(&mut tx, &*self.signer()?, why, &claim.suite_id, now_ms).await?;
        }
        commit(tx, "fail").await?;
        self.note_ends(has_ended);
        Ok(())
    }
}

/// A job that was taken.
struct Taken {
    id: String,
    attempt: i64,
    turn: i64,
}

/// Takes the first job of a lane that is free or whose lease has run out.
async fn take_first(tx: &mut SqliteConnection, lane: Lane, lease_ms: i64, now_ms: i64) -> StoreResult<Option<Taken>> {
    let taken: Option<(String, i64, i64)> = sqlx::query_as(
        "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
         WHERE submission_id = (SELECT submission_id FROM jobs
                                WHERE lane = $3 AND (lease_until_ms <= $1 OR lease_until_ms - lease_ms > $1)
                                ORDER BY turn, queued_at_ms, submission_id LIMIT 1)
         RETURNING submission_id, attempt, turn",
    )
    .bind(now_ms)
    .bind(lease_ms)
    .bind(lane.name())
    .fetch_optional(tx)
    .await?;
    Ok(taken.map(|(id, attempt, turn)| Taken { id, attempt, turn }))
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

/// Whether the job is still this attempt's.
pub(super) async fn holds(tx: &mut SqliteConnection, claim: &Claim) -> StoreResult<bool> {
    let attempt: Option<i64> = sqlx::query_scalar("SELECT attempt FROM jobs WHERE submission_id = $1")
        .bind(&claim.submission_id)
        .fetch_optional(&mut *tx)
        .await?;
    Ok(attempt == Some(claim.attempt))
}
