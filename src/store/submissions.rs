//! Submissions: an agent's log for one task each.

use std::sync::Arc;

use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection};

use super::idempotency::IdempotencyKey;
use super::queue::{self, Lane, NewJob};
use super::quota;
use super::run_rows::{count, run_in};
use super::states::RunState;
use super::states::SubmissionState;
use super::{Store, StoreError, StoreResult, compress, decompress};

/// Log as it is stored: canonical JSON, compressed.
#[derive(Debug, Clone)]
pub struct PackedLog {
    zstd: Vec<u8>,
    json_bytes: usize,
}

impl PackedLog {
    /// Compresses a log's canonical JSON. This is slow for a large log, so do not call it on a thread that serves
    /// requests.
    ///
    /// # Errors
    /// Returns an error if compression fails.
    pub fn of(json: &[u8]) -> StoreResult<Self> {
        Ok(Self { zstd: compress(json)?, json_bytes: json.len() })
    }
}

/// Submission to store.
#[derive(Debug, Clone)]
pub struct NewSubmission {
    /// Identifier of the submission, if it is new.
    pub id: String,
    /// Identifier of the run that it belongs to.
    pub run_id: Option<String>,
    /// `name@version` of the task's suite.
    pub suite_id: String,
    /// Hash of the task.
    pub task_hash: String,
    /// Number of the task in the suite.
    pub task_number: u32,
    /// SHA-256 of the log's canonical JSON, in hex.
    pub log_hash: String,
    /// The compressed log.
    pub log: PackedLog,
    /// Number of turns in the log.
    pub turns: usize,
    /// Number of events in the log.
    pub events: usize,
    /// Owner who posts it; none if the service is open to everyone.
    pub owner: Option<String>,
    /// Lane in which its job waits.
    pub lane: Lane,
    /// Results of the action code of its turns, as JSON; none if it had no action code.
    pub replays: Option<String>,
}

/// Outcome of storing a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Accepted {
    /// The submission is new and queued.
    New,
    /// The run already has the same log for this task, under this identifier.
    Same(String),
    /// The run already has a different log for this task, under this identifier.
    Other(String),
    /// The run accepts no more submissions.
    RunClosed,
    /// The owner's quota is used up.
    QuotaUsedUp,
}

/// Answer that a run already has for a task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EarlierAnswer {
    /// Identifier of the submission.
    pub id: String,
    /// SHA-256 of its log's canonical JSON, in hex.
    pub log_hash: String,
    /// State of the submission.
    pub state: SubmissionState,
}

/// Stored facts that decide whether a submission may be stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AcceptFacts {
    /// State of its run; `None` if it belongs to none, or to one that does not exist.
    pub run: Option<RunState>,
    /// Answer that its run already has for the same task.
    pub earlier: Option<EarlierAnswer>,
    /// Submissions that its owner may still post; `None` without a limit.
    pub quota_left: Option<i64>,
}

/// Decision on a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decision {
    /// The submission is stored. An earlier answer, which ended without a grade, no longer counts.
    Store {
        /// Earlier answer that no longer counts.
        supersedes: Option<EarlierAnswer>,
    },
    /// The submission is not stored, for this reason.
    Answer(Accepted),
}

/// Decides on a submission from stored facts; the use cases own the rule.
pub type Decide = fn(&NewSubmission, &AcceptFacts) -> Decision;

/// Outcome of a request to store submissions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Acceptability {
    /// The outcome of each submission, in the order given. If all are [`Accepted::New`] or [`Accepted::Same`], they are
    /// durable; otherwise none was stored.
    Decided(Vec<Accepted>),
    /// The same request was carried out before; holds the identifiers, and whether each existed even then, as JSON.
    Replayed(String),
    /// The idempotency key was used for a different request.
    KeyUsedOtherwise,
}

/// Row of a submission, without its log.
#[derive(Debug, Clone)]
pub struct SubmissionRow {
    /// Identifier of the submission.
    pub id: String,
    /// Identifier of the run that it belongs to.
    pub run_id: Option<String>,
    /// `name@version` of the task's suite.
    pub suite_id: String,
    /// Hash of the task.
    pub task_hash: String,
    /// Number of the task in the suite.
    pub task_number: u32,
    /// SHA-256 of the log's canonical JSON, in hex.
    pub log_hash: String,
    /// Size of that JSON, in bytes.
    pub log_bytes: i64,
    /// Number of turns in the log.
    pub turns: u32,
    /// Number of events in the log.
    pub events: i64,
    /// State of the submission.
    pub state: SubmissionState,
    /// Reason why it ended without a report.
    pub error: Option<String>,
    /// Time at which it was accepted, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time at which it ended, in milliseconds since 1970.
    pub ended_at_ms: Option<i64>,
    /// Verdict of the latest report.
    pub overall: Option<bool>,
    /// Verdict on accuracy of the latest report, if accuracy applies.
    pub accuracy: Option<bool>,
    /// Owner who posted it; none if the service was open to everyone.
    pub owner: Option<String>,
    /// Results of the action code of its turns, as JSON; none if it had no action code.
    pub replays: Option<String>,
}

macro_rules! select_submission {
    ($rest:literal) => {
        concat!(
            "SELECT s.id, s.run_id, s.suite_id, s.task_hash, s.task_number, s.log_hash, s.log_bytes, s.turns, s.events,
                    s.state, s.error, s.created_at_ms, s.ended_at_ms, r.overall, r.accuracy, s.owner, s.replays
             FROM public_submissions s LEFT JOIN latest_reports r ON r.submission_id = s.id ",
            $rest
        )
    };
}

fn read_submission(row: &SqliteRow) -> StoreResult<SubmissionRow> {
    Ok(SubmissionRow {
        id: row.try_get("id")?,
        run_id: row.try_get("run_id")?,
        suite_id: row.try_get("suite_id")?,
        task_hash: row.try_get("task_hash")?,
        task_number: row.try_get("task_number")?,
        log_hash: row.try_get("log_hash")?,
        log_bytes: row.try_get("log_bytes")?,
        turns: row.try_get("turns")?,
        events: row.try_get("events")?,
        state: row.try_get("state")?,
        error: row.try_get("error")?,
        created_at_ms: row.try_get("created_at_ms")?,
        ended_at_ms: row.try_get("ended_at_ms")?,
        overall: row.try_get("overall")?,
        accuracy: row.try_get("accuracy")?,
        owner: row.try_get("owner")?,
        replays: row.try_get("replays")?,
    })
}

impl Store {
    /// Stores submissions and their jobs: all of them, or none if one is refused. Requests that arrive at the same time
    /// share a transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is stored.
    pub async fn accept(
        &self,
        submissions: Arc<[NewSubmission]>,
        once: Option<IdempotencyKey>,
        decide: Decide,
        now_ms: i64,
    ) -> StoreResult<Acceptability> {
        self.acceptances.store(submissions, once, decide, now_ms).await
    }

    /// Reads the facts that decide whether each submission may be stored, without waiting for the writer.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn accept_facts(&self, submissions: &[NewSubmission]) -> StoreResult<Vec<AcceptFacts>> {
        // A single transaction reads a consistent snapshot.
        let mut reading = self.readers.begin().await?;
        let mut facts = Vec::with_capacity(submissions.len());
        for submission in submissions {
            facts.push(facts_of(&mut reading, submission).await?);
        }
        Ok(facts)
    }

    /// Returns the submission with this identifier; none if it answers a hidden instance, which only `instances` may
    /// show.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn submission(&self, id: &str) -> StoreResult<Option<SubmissionRow>> {
        let row = sqlx::query(select_submission!("WHERE s.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read_submission).transpose()
    }

    /// Returns at most `limit` submissions of a run after task number `after`, in order of task number, without
    /// superseded ones.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn submissions_of_run(&self, run_id: &str, after: i64, limit: i64) -> StoreResult<Vec<SubmissionRow>> {
        let rows = sqlx::query(select_submission!(
            "WHERE s.run_id = $1 AND s.superseded = 0 AND s.task_number > $2 ORDER BY s.task_number LIMIT $3"
        ))
        .bind(run_id)
        .bind(after)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(read_submission).collect()
    }

    /// Returns the log of a submission as canonical JSON; none if it answers a hidden instance.
    ///
    /// # Errors
    /// Returns an error if the database fails or the log cannot be read.
    pub async fn log_json(&self, id: &str) -> StoreResult<Option<Vec<u8>>> {
        let sql = "SELECT log FROM public_submissions WHERE id = $1";
        let log: Option<Vec<u8>> = sqlx::query_scalar(sql).bind(id).fetch_optional(&self.readers).await?;
        let Some(log) = log else { return Ok(None) };
        let unpacked = tokio::task::spawn_blocking(move || decompress("submissions", &log));
        unpacked.await.map_err(|error| StoreError::corrupt("submissions", error))?.map(Some)
    }

    /// Returns the number of submissions that have not ended, and the age of the oldest in milliseconds. Answers to
    /// hidden instances are left out, because the number would reveal when they are graded.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn backlog(&self, now_ms: i64) -> StoreResult<(i64, i64)> {
        let (open, oldest): (i64, Option<i64>) =
            sqlx::query_as("SELECT COUNT(*), MIN(created_at_ms) FROM public_submissions WHERE ended_at_ms IS NULL")
                .fetch_one(&self.readers)
                .await?;
        Ok((open, oldest.map_or(0, |oldest| (now_ms - oldest).max(0))))
    }
}

/// Reads the facts that decide whether a submission may be stored.
async fn facts_of(connection: &mut SqliteConnection, new: &NewSubmission) -> StoreResult<AcceptFacts> {
    let (mut run, mut earlier) = (None, None);
    if let Some(run_id) = &new.run_id {
        run = run_in(connection, run_id).await?.map(|run| run.state);
        let found: Option<(String, String, SubmissionState)> = sqlx::query_as(
            "SELECT id, log_hash, state FROM submissions WHERE run_id = $1 AND task_number = $2 AND superseded = 0",
        )
        .bind(run_id)
        .bind(i64::from(new.task_number))
        .fetch_optional(&mut *connection)
        .await?;
        if let Some((id, log_hash, state)) = found {
            earlier = Some(EarlierAnswer { id, log_hash, state });
        }
    }
    let quota_left = quota::left(connection, new.owner.as_deref()).await?;
    Ok(AcceptFacts { run, earlier, quota_left })
}

/// Stores a submission and its job, if `decide` allows it.
pub(super) async fn accept_one(
    tx: &mut SqliteConnection,
    new: &NewSubmission,
    decide: Decide,
    now_ms: i64,
) -> StoreResult<Accepted> {
    accept_instead(tx, new, None, decide, now_ms).await
}

/// Does the same as [`accept_one`]. A submission that replaces `earlier` takes over its reservation of the quota.
pub(super) async fn accept_instead(
    tx: &mut SqliteConnection,
    new: &NewSubmission,
    earlier: Option<&str>,
    decide: Decide,
    now_ms: i64,
) -> StoreResult<Accepted> {
    let mut facts = facts_of(tx, new).await?;
    if earlier.is_some() {
        facts.quota_left = None;
    }
    let supersedes = match decide(new, &facts) {
        Decision::Answer(answer) => return Ok(answer),
        Decision::Store { supersedes } => supersedes,
    };
    if earlier.is_none() {
        quota::reserve(tx, new.owner.as_deref()).await?;
    }
    if let Some(run_id) = &new.run_id {
        let was_error = supersedes.as_ref().is_some_and(|answer| answer.state == SubmissionState::GraderError);
        count(tx, run_id, 1, 0, -i64::from(was_error)).await?;
    }
    if let Some(answer) = supersedes {
        sqlx::query("UPDATE submissions SET superseded = 1 WHERE id = $1").bind(answer.id).execute(&mut *tx).await?;
    }
    sqlx::query(
        "INSERT INTO submissions (id, run_id, suite_id, task_hash, task_number, log_hash, log, log_bytes, turns, events,
                                  state, created_at_ms, owner, replays)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, 'queued', $11, $12, $13)",
    )
    .bind(&new.id)
    .bind(&new.run_id)
    .bind(&new.suite_id)
    .bind(&new.task_hash)
    .bind(i64::from(new.task_number))
    .bind(&new.log_hash)
    .bind(new.log.zstd.as_slice())
    .bind(new.log.json_bytes as i64)
    .bind(new.turns as i64)
    .bind(new.events as i64)
    .bind(now_ms)
    .bind(&new.owner)
    .bind(&new.replays)
    .execute(&mut *tx)
    .await?;
    let job = NewJob { submission_id: &new.id, owner: new.owner.as_deref(), lane: new.lane };
    queue::enter(tx, &job, now_ms).await?;
    match earlier {
        None => quota::note_reserved(tx, new.owner.as_deref(), &new.id, now_ms).await?,
        Some(earlier) => quota::hand_over(tx, earlier, &new.id).await?,
    }
    Ok(Accepted::New)
}
