//! Submissions in the API: the bodies of responses.

use serde::Serialize;

use crate::actions::turn_replay::TurnReplay;
use crate::app::error::AppResult;
use crate::app::submissions::accept::AcceptedSubmission;
use crate::app::submissions::read::replays;
use crate::clock::rfc3339;
use crate::store::states::SubmissionState;
use crate::store::submissions::{NewSubmission, SubmissionRow};
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::voxel::Profile;

/// A submission.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SubmissionBody {
    /// Identifier of the submission.
    #[schema(format = Uuid)]
    pub id: String,
    /// Identifier of the run that it belongs to, if any.
    #[schema(format = Uuid)]
    pub run: Option<String>,
    /// `name@version` of the task's suite.
    pub suite: String,
    /// Identifier of the task.
    pub task: String,
    /// Number of the task in the suite.
    pub number: u32,
    /// `queued`, `grading`, `graded`, `rejected`, `grader_error` (service failure; post it again, or see `superseded_by`) or `cancelled`.
    #[schema(value_type = SubmissionState, example = "graded")]
    pub state: &'static str,
    /// Reason why it ended without a report.
    pub error: Option<String>,
    /// Whether the problem passes, once graded.
    pub overall: Option<bool>,
    /// Whether the accuracy passes, once graded and if it applies.
    pub accuracy: Option<bool>,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Number of turns in the log.
    #[schema(minimum = 0)]
    pub turns: i64,
    /// Number of events in the log.
    #[schema(minimum = 0)]
    pub events: i64,
    /// Time at which it was accepted (RFC 3339).
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it ended (RFC 3339).
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Owner of the key that posted it; null if it was posted without a key, or if its run is under embargo.
    pub owner: Option<String>,
    /// Identifier of the submission that took its place, after a `grader_error` or `cancelled`. That may have another log.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(format = Uuid)]
    pub superseded_by: Option<String>,
    /// Number of submissions ahead of it while it is queued; counted up to 10,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub queued_before: Option<i64>,
    /// Estimated seconds until it is graded, while it is queued, at the pace of the latest gradings.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub estimated_seconds: Option<f64>,
    /// Rules under which its actions became a build.
    pub profile: Profile,
    /// Results of the action code in its turns, if there was any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl SubmissionBody {
    /// Builds the body of a stored submission; `entry` is the suite of its task.
    ///
    /// # Errors
    /// Returns an error if the stored results of its action code are damaged.
    pub fn of(row: SubmissionRow, entry: &Entry) -> AppResult<Self> {
        let number = row.task_number;
        Ok(Self {
            task: entry.task_numbered(number).map(|(task, _)| task.id.clone()).unwrap_or_default(),
            number,
            id: row.id,
            run: row.run_id,
            suite: row.suite_id,
            state: row.state.name(),
            error: row.error,
            overall: row.overall,
            accuracy: row.accuracy,
            log_hash: row.log_hash,
            turns: row.turns.into(),
            events: row.events,
            created_at: rfc3339(row.created_at_ms),
            ended_at: row.ended_at_ms.map(rfc3339),
            owner: row.owner.filter(|_| !row.is_anonymous),
            superseded_by: row.superseded_by,
            queued_before: None,
            estimated_seconds: None,
            profile: row.profile,
            action_code: replays(row.replays.as_deref())?,
        })
    }
}

/// An accepted submission.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct AcceptedBody {
    /// Identifier of the submission.
    #[schema(format = Uuid)]
    pub id: String,
    /// Whether the run already held the same log for the task, so that nothing was stored.
    pub repeated: bool,
    /// Results of the action code in its turns, if there was any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl From<AcceptedSubmission> for AcceptedBody {
    fn from(AcceptedSubmission { id, repeated, action_code }: AcceptedSubmission) -> Self {
        Self { id, repeated, action_code }
    }
}

/// Accepted submissions of an NDJSON body.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct AcceptedList {
    /// The submissions, in the order of the lines.
    pub submissions: Vec<AcceptedBody>,
}

/// Response to a post of one submission, or of an NDJSON body.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum AcceptedAnswer {
    /// Response to a JSON body.
    One(AcceptedBody),
    /// Response to an NDJSON body.
    Lines(AcceptedList),
}

/// A submission that would be accepted.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Validated {
    /// `name@version` of the task's suite.
    #[schema(example = "mineceraft@4")]
    pub suite: String,
    /// Number of the task in the suite.
    #[schema(example = 113)]
    pub number: u32,
    /// Number of turns in the log.
    pub turns: usize,
    /// Number of events in the log.
    pub events: usize,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Whether the run already holds the same log for the task.
    pub repeated: bool,
    /// Results of the action code in its turns, if there was any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl Validated {
    /// Builds the description of a submission that is ready to store.
    #[must_use]
    pub fn of(new: &NewSubmission, accepted: &AcceptedSubmission) -> Self {
        Self {
            suite: new.suite_id.clone(),
            number: new.task_number,
            turns: new.turns,
            events: new.events,
            log_hash: new.log_hash.clone(),
            repeated: accepted.repeated,
            action_code: accepted.action_code.clone(),
        }
    }
}

/// The submissions of a body, all of which would be accepted.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ValidatedList {
    /// The submissions, in the order of the body.
    pub submissions: Vec<Validated>,
}
