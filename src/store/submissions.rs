//! Submissions: an agent's log for one task each.

use super::compression::{compress, decompress};
use super::db::{Row, query, query_as, query_scalar};
use super::queue::Lane;
use super::states::SubmissionState;
use super::{Store, StoreError, StoreResult};
use plumbline_engine::voxel::{BlockLog, Profile};

/// Reads a log from its stored bytes.
///
/// # Errors
/// Returns an error if they cannot be read.
pub(super) fn stored_log(bytes: &[u8]) -> StoreResult<BlockLog> {
    let json = decompress("submissions", bytes)?;
    BlockLog::from_canonical_json(&json).map_err(|error| StoreError::corrupt("submissions", error))
}

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

    /// Returns the compressed bytes, or the reference to an object that holds them.
    pub(super) fn zstd(&self) -> &[u8] {
        &self.zstd
    }

    /// Takes the compressed bytes, to make them an object.
    pub(super) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.zstd)
    }

    /// Sets what the column holds instead.
    pub(super) fn set(&mut self, column: Vec<u8>) {
        self.zstd = column;
    }

    /// Returns the size of the canonical JSON in bytes.
    pub(super) const fn json_bytes(&self) -> usize {
        self.json_bytes
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
    /// SHA-256 of the task's canonical JSON, in hex.
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
    /// Rules under which its actions become a build.
    pub profile: Profile,
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
    /// SHA-256 of the task's canonical JSON, in hex.
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
    /// Rules under which its actions become a build.
    pub profile: Profile,
    /// Identifier of the submission that took its place.
    pub superseded_by: Option<String>,
    /// Whether its run is under embargo, so that its owner is not shown.
    pub is_anonymous: bool,
}

macro_rules! select_submission {
    ($rest:literal) => {
        concat!(
            "SELECT s.id, s.run_id, s.suite_id, s.task_hash, s.task_number, s.log_hash, s.log_bytes, s.turns, s.events,
                    s.state, s.error, s.created_at_ms, s.ended_at_ms, r.overall, r.accuracy, s.owner, s.replays,
                    s.profile, s.superseded_by, EXISTS (SELECT 1 FROM embargoes e WHERE e.run_id = s.run_id AND e.lifted_at_ms IS NULL) AS is_anonymous
             FROM public_submissions s LEFT JOIN latest_reports r ON r.submission_id = s.id ",
            $rest
        )
    };
}

fn read_submission(row: &Row) -> StoreResult<SubmissionRow> {
    Ok(SubmissionRow {
        id: row.get("id")?,
        run_id: row.get("run_id")?,
        suite_id: row.get("suite_id")?,
        task_hash: row.get("task_hash")?,
        task_number: row.get("task_number")?,
        log_hash: row.get("log_hash")?,
        log_bytes: row.get("log_bytes")?,
        turns: row.get("turns")?,
        events: row.get("events")?,
        state: row.get("state")?,
        error: row.get("error")?,
        created_at_ms: row.get("created_at_ms")?,
        ended_at_ms: row.get("ended_at_ms")?,
        overall: row.get("overall")?,
        accuracy: row.get("accuracy")?,
        owner: row.get("owner")?,
        replays: row.get("replays")?,
        profile: row.get::<Option<Profile>>("profile")?.unwrap_or_default(),
        superseded_by: row.get("superseded_by")?,
        is_anonymous: row.get("is_anonymous")?,
    })
}

impl Store {
    /// Returns the submission with this identifier; none if it answers a hidden instance, which only `instances` may
    /// show.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn submission(&self, id: &str) -> StoreResult<Option<SubmissionRow>> {
        let row = query(select_submission!("WHERE s.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read_submission).transpose()
    }

    /// Returns at most `limit` submissions of a run after task number `after`, in order of task number, without
    /// superseded ones.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn submissions_of_run(&self, run_id: &str, after: i64, limit: i64) -> StoreResult<Vec<SubmissionRow>> {
        let rows = query(select_submission!(
            "WHERE s.run_id = $1 AND s.superseded = FALSE AND s.task_number > $2 ORDER BY s.task_number LIMIT $3"
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
        let log: Option<Vec<u8>> = query_scalar(sql).bind(id).fetch_optional(&self.readers).await?;
        let Some(log) = log else { return Ok(None) };
        let log = self.blobs.fetch(&self.readers, log).await?;
        let unpacked = tokio::task::spawn_blocking(move || decompress("submissions", &log));
        unpacked.await.map_err(|error| StoreError::failed("unpacking a log", error))?.map(Some)
    }

    /// Returns the number of submissions that have not ended, and the age of the oldest in milliseconds. Answers to
    /// hidden instances are left out, because the number would reveal when they are graded.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn backlog(&self, now_ms: i64) -> StoreResult<(i64, i64)> {
        let (open, oldest): (i64, Option<i64>) =
            query_as("SELECT COUNT(*), MIN(created_at_ms) FROM public_submissions WHERE ended_at_ms IS NULL")
                .fetch_one(&self.readers)
                .await?;
        Ok((open, oldest.map_or(0, |oldest| (now_ms - oldest).max(0))))
    }
}
