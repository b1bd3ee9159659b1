//! Submissions in the API: the bodies of requests and responses.

use serde::{Deserialize, Serialize};

use crate::actions::turn_replay::TurnReplay;
use crate::app::replay::EventAction;
use crate::app::submissions::accept::AcceptedSubmission;
use crate::clock::rfc3339;
use crate::store::states::SubmissionState;
use crate::store::submissions::{NewSubmission, SubmissionRow};
use plumbline_engine::tasks::catalogue::Entry;

/// An agent's work on one task.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "run": "0198c0de-0000-7000-8000-000000000000", "task": "walls/5x1x5-raise",
    "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
}))]
#[expect(dead_code, reason = "describes the body that SubmissionShape reads")]
pub struct NewSubmissionBody {
    /// Run that the submission belongs to. Without a run it is graded all the same, but appears on no board.
    #[schema(format = Uuid)]
    run: Option<String>,
    /// Suite of the task, if the submission belongs to no run: name, or name@version.
    #[schema(min_length = 1, max_length = 100)]
    suite: Option<String>,
    /// The task: its id, or its number in the suite (the `run_idx` of published records).
    task: TaskName,
    /// Turns of the log, as many as the task has. Either `turns` or `log` is required.
    #[schema(max_items = 64)]
    turns: Option<Vec<NewTurn>>,
    /// The log in the stored form, as `/v1/submissions/{id}/log` returns it.
    log: Option<StoredLogBody>,
}

/// A log in the stored form.
#[derive(Debug, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "palette": ["stone"], "turns": [[[0, 0, 0, 0]]] }))]
pub struct StoredLogBody {
    /// Names of materials.
    palette: Vec<String>,
    /// Rows of each turn: `[x, y, z, i]` places a block of palette entry i, `[x, y, z]` removes one.
    turns: Vec<Vec<Vec<i32>>>,
}

/// Reference to a task of a suite.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum TaskName {
    /// Identifier of the task.
    #[schema(example = "walls/5x1x5-raise")]
    Id(String),
    /// Number of the task in the suite.
    Number(u32),
}

/// A turn: plain events, a palette and rows, or action code.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "describes the body that the log reader reads")]
pub struct NewTurn {
    /// Events, in order.
    #[schema(max_items = 400_000)]
    events: Option<Vec<NewEvent>>,
    /// Compact form: names of the materials that `rows` refer to.
    palette: Option<Vec<String>>,
    /// Compact form: `[x, y, z, i]` places a block of palette entry i, `[x, y, z]` removes one.
    #[schema(max_items = 400_000)]
    rows: Option<Vec<Vec<i32>>>,
    /// Instead of events: JavaScript as agents of the mindcraft framework write it, bare or in a code fence. The
    /// service runs it; the blocks that it places and removes are the events.
    #[schema(max_length = 524_288)]
    action_code: Option<String>,
}

/// An event: a block that is placed or removed.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "describes the body that the log reader reads")]
pub struct NewEvent {
    /// `place` or `remove`.
    #[schema(value_type = EventAction, example = "place")]
    action: String,
    /// Coordinate to the east.
    #[schema(minimum = -30_000_000, maximum = 30_000_000)]
    x: i32,
    /// Coordinate upwards; the ground surface is y <= 0.
    #[schema(minimum = -2048, maximum = 2047)]
    y: i32,
    /// Coordinate to the south.
    #[schema(minimum = -30_000_000, maximum = 30_000_000)]
    z: i32,
    /// Name of the material; required for `place`.
    #[schema(max_length = 128, example = "stone")]
    material: Option<String>,
}

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
    /// `queued`, `grading`, `graded`, `rejected`, `grader_error` (service failure; post it again) or `cancelled`.
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
    /// Owner of the key that posted it; null if it was posted without a key.
    pub owner: Option<String>,
    /// Number of submissions ahead of it while it is queued; counted up to 10,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub queued_before: Option<i64>,
    /// Estimated seconds until it is graded, while it is queued, at the pace of the latest gradings.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub estimated_seconds: Option<f64>,
    /// Results of the action code in its turns, if there was any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl SubmissionBody {
    /// Builds the body of a stored submission; `entry` is the suite of its task.
    #[must_use]
    pub fn of(row: SubmissionRow, entry: &Entry) -> Self {
        let number = row.task_number;
        Self {
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
            owner: row.owner,
            queued_before: None,
            estimated_seconds: None,
            action_code: row.replays.and_then(|json| serde_json::from_str(&json).ok()).unwrap_or_default(),
        }
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
    #[schema(example = "mineceraft@2")]
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
    pub fn of(new: &NewSubmission, repeated: bool) -> Self {
        Self {
            suite: new.suite_id.clone(),
            number: new.task_number,
            turns: new.turns,
            events: new.events,
            log_hash: new.log_hash.clone(),
            repeated,
            action_code: new.replays.as_ref().and_then(|json| serde_json::from_str(json).ok()).unwrap_or_default(),
        }
    }
}

/// The submissions of a body, all of which would be accepted.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ValidatedList {
    /// The submissions, in the order of the body.
    pub submissions: Vec<Validated>,
}
