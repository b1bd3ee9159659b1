//! Claims: workers take jobs from the queue under a lease.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI64, Ordering};

use super::blobs::Blobs;
use super::db::{Builder, Each, Tx, query_as, query_scalar};
use super::job_ends::MAX_ATTEMPTS;
use super::jobs::{Claim, HiddenJob};
use super::queue::{Lane, note_taken};
use super::{Store, StoreError, StoreResult, commit};
use crate::clock::now_ms;

/// Outcome of looking for work.
#[derive(Debug)]
pub enum Claimed {
    /// Jobs to grade: one job, or several quick ones.
    Jobs(Vec<Claim>),
    /// A job had no attempts left, and its submission ended as `grader_error`. There may be more work.
    GivenUp,
    /// There is nothing to do now.
    Nothing,
}

impl Store {
    /// Takes the next job that is free or whose lease has expired, from the first of these lanes that has one, under a
    /// lease of `lease_ms` that begins once this transaction has the write lock. If the job is quick and was never
    /// begun, takes up to `most` such jobs at once. A job that was begun before is taken alone, so that a fault in it
    /// cannot affect others.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn claim(&self, lanes: &[Lane], lease_ms: i64, most: usize) -> StoreResult<Claimed> {
        // Workers of other lanes look for themselves.
        let looks = &self.looks[*lanes.first().expect("a worker has a lane") as usize];
        let begun = std::time::Instant::now();
        let is_thorough = looks.is_due(lease_ms, now_ms());
        let has_jobs = self.has_jobs(lanes, is_thorough).await?;
        if is_thorough {
            looks.took(begun.elapsed());
        }
        if !has_jobs {
            return Ok(Claimed::Nothing);
        }
        let mut tx = self.begin().await?;
        let now_ms = now_ms();
        let mut first = None;
        for lane in lanes {
            first = take_first(&mut tx, *lane, lease_ms, now_ms, is_thorough).await?.map(|taken| (*lane, taken));
            if first.is_some() {
                break;
            }
        }
        let Some((lane, Taken { id, attempt, turn, is_far_behind })) = first else { return Ok(Claimed::Nothing) };
        if is_far_behind {
            // Whoever died, or was slow, left more than one job behind.
            looks.again();
        }
        if attempt > MAX_ATTEMPTS {
            // Its run and owner are locked before its job, so it is given up in a transaction of its own.
            note_taken(&mut tx, lane, turn).await?;
            commit(tx, "claim (no attempts left)").await?;
            self.give_up(&id, attempt, now_ms).await?;
            return Ok(Claimed::GivenUp);
        }
        let (mut taken, mut last_turn) = (vec![(id, attempt)], turn);
        if lane == Lane::Quick && attempt == 1 {
            let more: Vec<(String, i64, i64)> = query_as(Each {
                sqlite: "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
                         WHERE submission_id IN (SELECT submission_id FROM jobs
                                                 WHERE lane = 'quick' AND lease_until_ms <= $1 AND attempt = 0
                                                 ORDER BY turn, queued_at_ms, submission_id LIMIT $3)
                         RETURNING submission_id, attempt, turn",
                // Without MATERIALIZED the server may run the inner statement several times, each with rows of its own.
                postgres: "WITH free AS MATERIALIZED (
                               SELECT submission_id FROM jobs
                               WHERE lane = 'quick' AND lease_until_ms <= now_ms() AND attempt = 0
                                 AND turn >= CASE WHEN $4 THEN 0 ELSE (SELECT turn - 256 FROM lanes WHERE name = 'quick') END
                               ORDER BY turn, queued_at_ms, submission_id LIMIT $3
                               FOR UPDATE SKIP LOCKED)
                           UPDATE jobs SET attempt = attempt + 1, lease_until_ms = now_ms() + $2, lease_ms = $2
                           WHERE submission_id IN (SELECT submission_id FROM free)
                           RETURNING submission_id, attempt, turn",
            })
            .bind(now_ms)
            .bind(lease_ms)
            .bind(most.saturating_sub(1) as i64)
            .bind(is_thorough)
            .fetch_all(&mut tx)
            .await?;
            last_turn = more.iter().map(|(_, _, turn)| *turn).fold(last_turn, i64::max);
            taken.extend(more.into_iter().map(|(id, attempt, _)| (id, attempt)));
        }
        let mut update = Builder::new("UPDATE submissions SET state = 'grading' WHERE id IN ");
        update.push_list(taken.iter().map(|(id, _)| id.as_str()));
        update.build().execute(&mut tx).await?;
        let mut select = Builder::new(
            "SELECT s.id, s.run_id, s.suite_id, s.task_number, s.log, s.owner, s.log_hash, s.created_at_ms, i.id AS instance_id, i.epoch_id,
                    i.salt, i.task_hash, CASE WHEN i.id IS NULL THEN NULL ELSE t.body END AS task
             FROM submissions s LEFT JOIN instances i ON i.id = s.instance_id LEFT JOIN tasks t ON t.hash = i.task_hash
             WHERE s.id IN ",
        );
        select.push_list(taken.iter().map(|(id, _)| id.as_str()));
        let rows = select.build().fetch_all(&mut tx).await?;
        // Last, because all claims of a lane write this row: whoever waits while holding it blocks all others.
        note_taken(&mut tx, lane, last_turn).await?;
        commit(tx, "claim").await?;
        let attempts: HashMap<String, i64> = taken.into_iter().collect();
        let mut claims = Vec::with_capacity(rows.len());
        for row in rows {
            let submission_id: String = row.get("id")?;
            claims.push(Claim {
                attempt: *attempts.get(&submission_id).expect("the rows are those of the jobs taken"),
                submission_id,
                run_id: row.get("run_id")?,
                suite_id: row.get("suite_id")?,
                task_number: row.get("task_number")?,
                log: row.get("log")?,
                lost: None,
                owner: row.get("owner")?,
                log_hash: row.get("log_hash")?,
                hidden: match row.get::<Option<String>>("instance_id")? {
                    None => None,
                    Some(instance_id) => Some(HiddenJob {
                        instance_id,
                        epoch_id: row.get("epoch_id")?,
                        answered_at_ms: row.get("created_at_ms")?,
                        salt: row.get("salt")?,
                        task_hash: row.get("task_hash")?,
                        task: row.get("task")?,
                    }),
                },
            });
        }
        Ok(Claimed::Jobs(self.with_logs(claims).await?))
    }

    /// Fetches the logs that are objects. If their place cannot be reached, these jobs are given back, and the attempts
    /// do not count. A log that is lost is noted: its job ends when it is read.
    async fn with_logs(&self, claims: Vec<Claim>) -> StoreResult<Vec<Claim>> {
        let mut ready = Vec::with_capacity(claims.len());
        let mut failure = None;
        for mut claim in claims {
            if !Blobs::is_reference(&claim.log) {
                ready.push(claim);
                continue;
            }
            if failure.is_some() {
                self.give_back(&claim, false).await?;
                continue;
            }
            match self.blobs.fetch(&self.readers, claim.log.clone()).await {
                Ok(log) => claim.log = log,
                Err(StoreError::BlobLost(detail)) => claim.lost = Some(detail),
                Err(error) => {
                    self.give_back(&claim, false).await?;
                    failure = Some(error);
                    continue;
                }
            }
            ready.push(claim);
        }
        match failure {
            Some(error) if ready.is_empty() => Err(error),
            Some(error) => {
                tracing::warn!(%error, "the logs of some jobs cannot be fetched now; they were given back");
                Ok(ready)
            }
            None => Ok(ready),
        }
    }

    /// Returns whether one of the lanes has jobs that a claim may take, free or not. Most checks find none, and need not
    /// wait for the write lock. As in [`take_first`], PostgreSQL looks through earlier rounds only if `is_thorough` is set.
    async fn has_jobs(&self, lanes: &[Lane], is_thorough: bool) -> StoreResult<bool> {
        let exists = Each {
            sqlite: "SELECT EXISTS (SELECT 1 FROM jobs WHERE lane = $1)",
            postgres: "SELECT EXISTS (SELECT 1 FROM jobs WHERE lane = $1
                                        AND turn >= CASE WHEN $2 THEN 0 ELSE (SELECT turn - 256 FROM lanes WHERE name = $1) END)",
        };
        for lane in lanes {
            let has_one: bool = query_scalar(exists).bind(*lane).bind(is_thorough).fetch_one(&self.readers).await?;
            if has_one {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Times at which this process looks through all jobs of the lanes, not only those of the current rounds.
#[derive(Debug, Default)]
pub(super) struct Looks {
    last_ms: AtomicI64,
    /// How long the last one took.
    took_ms: AtomicI64,
}

impl Looks {
    /// Makes a look due at once: the last one found a job, and there may be more.
    fn again(&self) {
        self.last_ms.store(0, Ordering::Relaxed);
    }

    /// Notes how long a look took.
    fn took(&self, time: std::time::Duration) {
        self.took_ms.store(time.as_millis() as i64, Ordering::Relaxed);
    }

    /// Returns whether such a look is due: four times in the length of a lease, so that a job whose worker died is
    /// found soon after its lease ends. Looks that take long, because very many deleted jobs are in the index, are made
    /// less often: they take a twentieth of the time, or one is made in the length of a lease.
    fn is_due(&self, lease_ms: i64, now_ms: i64) -> bool {
        let last_ms = self.last_ms.load(Ordering::Relaxed);
        let least_ms = (lease_ms / 4).min(2_000);
        let every_ms = (20 * self.took_ms.load(Ordering::Relaxed)).min(lease_ms).max(least_ms);
        let is_due = now_ms < last_ms || now_ms - last_ms >= every_ms;
        is_due && self.last_ms.compare_exchange(last_ms, now_ms, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

/// Job that was taken.
struct Taken {
    id: String,
    attempt: i64,
    turn: i64,
    /// Whether only a thorough look finds such a job.
    is_far_behind: bool,
}

/// Takes the first job of a lane that is free, whose lease has expired, or whose lease begins in the future, as after a
/// clock was set back.
///
/// On PostgreSQL, jobs that another node is taking are passed over. A lease may begin a moment after this statement; only
/// one that begins more than a minute later shows that a clock was set back. Rounds far below the lane's hold only jobs
/// that were taken before, or that were accepted very slowly. They are looked through only if `is_thorough` is set,
/// because the index keeps the entries of deleted jobs for as long as any transaction is open.
async fn take_first(
    tx: &mut Tx,
    lane: Lane,
    lease_ms: i64,
    now_ms: i64,
    is_thorough: bool,
) -> StoreResult<Option<Taken>> {
    let taken: Option<(String, i64, i64, bool)> = query_as(Each {
        sqlite: "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = $1 + $2, lease_ms = $2
                 WHERE submission_id = (SELECT submission_id FROM jobs
                                        WHERE lane = $3 AND (lease_until_ms <= $1 OR lease_until_ms - lease_ms > $1)
                                        ORDER BY turn, queued_at_ms, submission_id LIMIT 1)
                 RETURNING submission_id, attempt, turn, FALSE",
        postgres: "UPDATE jobs SET attempt = attempt + 1, lease_until_ms = now_ms() + $2, lease_ms = $2
                   WHERE submission_id = (SELECT submission_id FROM jobs
                                          WHERE lane = $3 AND (lease_until_ms <= now_ms() OR lease_until_ms - lease_ms > now_ms() + 60000)
                                            AND turn >= CASE WHEN $4 THEN 0 ELSE (SELECT turn - 256 FROM lanes WHERE name = $3) END
                                          ORDER BY turn, queued_at_ms, submission_id LIMIT 1
                                          FOR UPDATE SKIP LOCKED)
                   RETURNING submission_id, attempt, turn, turn < (SELECT turn - 256 FROM lanes WHERE name = $3)",
    })
    .bind(now_ms)
    .bind(lease_ms)
    .bind(lane)
    .bind(is_thorough)
    .fetch_optional(tx)
    .await?;
    Ok(taken.map(|(id, attempt, turn, is_far_behind)| Taken { id, attempt, turn, is_far_behind }))
}
