//! Submissions as the API shows them: what is posted, what is answered.

use serde::{Deserialize, Serialize};

use crate::app::replay::{EventAction, TurnReplay};
use crate::app::submissions::accept::AcceptedSubmission;
use crate::clock::rfc3339;
use crate::store::submissions::{NewSubmission, SubmissionRow, SubmissionState};
use plumbline_engine::tasks::catalogue::Entry;

/// What an agent did for one task.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "run": "0198c0de-0000-7000-8000-000000000000", "task": "walls/5x1x5-raise",
    "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
}))]
#[expect(dead_code, reason = "describes the body that SubmissionShape reads")]
pub struct NewSubmissionBody {
    /// Run that it belongs to. Without one it is graded all the same, and is on no board.
    #[schema(format = Uuid)]
    run: Option<String>,
    /// Suite of the task, where it belongs to no run: name, or name@version.
    #[schema(min_length = 1, max_length = 100)]
    suite: Option<String>,
    /// The task: its id, or its number in the suite (the `run_idx` of published records).
    task: TaskName,
    /// What was done in each turn; as many as the task has. Either this or `log` is needed.
    #[schema(max_items = 64)]
    turns: Option<Vec<NewTurn>>,
    /// The same in the stored form, as `/v1/submissions/{id}/log` shows it.
    log: Option<StoredLogBody>,
}

/// A log in the stored form.
#[derive(Debug, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "palette": ["stone"], "turns": [[[0, 0, 0, 0]]] }))]
pub struct StoredLogBody {
    /// Names of materials.
    palette: Vec<String>,
    /// Per turn its rows: `[x, y, z, i]` places palette entry i, `[x, y, z]` removes.
    turns: Vec<Vec<Vec<i32>>>,
}

/// How a task is named.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum TaskName {
    /// Its id.
    #[schema(example = "walls/5x1x5-raise")]
    Id(String),
    /// Its number in the suite.
    Number(u32),
}

/// A turn: either plain events, or a palette and rows.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "describes the body that the log reader reads")]
pub struct NewTurn {
    /// Events in order.
    #[schema(max_items = 400_000)]
    events: Option<Vec<NewEvent>>,
    /// Compact form: material names.
    palette: Option<Vec<String>>,
    /// Compact form: `[x, y, z, i]` places palette entry i, `[x, y, z]` removes.
    #[schema(max_items = 400_000)]
    rows: Option<Vec<Vec<i32>>>,
    /// Instead of events: JavaScript as agents of the mindcraft framework write it, bare or in a code fence. It is run, and what it
    /// places and removes are the events.
    #[schema(max_length = 524_288)]
    action_code: Option<String>,
}

/// One action.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "describes the body that the log reader reads")]
pub struct NewEvent {
    /// `place` or `remove`.
    #[schema(value_type = EventAction, example = "place")]
    action: String,
    /// East.
    #[schema(minimum = -30_000_000, maximum = 30_000_000)]
    x: i32,
    /// Up; the ground surface is y <= 0.
    #[schema(minimum = -2048, maximum = 2047)]
    y: i32,
    /// South.
    #[schema(minimum = -30_000_000, maximum = 30_000_000)]
    z: i32,
    /// Material; needed to place.
    #[schema(max_length = 128, example = "stone")]
    material: Option<String>,
}

/// A submission.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SubmissionBody {
    /// Its id.
    #[schema(format = Uuid)]
    pub id: String,
    /// Run that it belongs to.
    #[schema(format = Uuid)]
    pub run: Option<String>,
    /// `name@version` of the task's suite.
    pub suite: String,
    /// The task's id.
    pub task: String,
    /// The task's number in the suite.
    pub number: u32,
    /// `queued`, `grading`, `graded`, `rejected`, `grader_error` (a failure of ours; post it again) or `cancelled`.
    #[schema(value_type = SubmissionState, example = "graded")]
    pub state: &'static str,
    /// Why it ended without a report.
    pub error: Option<String>,
    /// Whether the problem passes, once graded.
    pub overall: Option<bool>,
    /// Whether its accuracy passes, once graded and where it applies.
    pub accuracy: Option<bool>,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Turns of the log.
    #[schema(minimum = 0)]
    pub turns: i64,
    /// Events of the log.
    #[schema(minimum = 0)]
    pub events: i64,
    /// When it was accepted.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// When it ended.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Whose key posted it; null where the service is open to everybody.
    pub owner: Option<String>,
    /// While it waits: how many are graded before it; counted up to 10,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub queued_before: Option<i64>,
    /// While it waits: seconds until it is begun, at the pace of the last gradings.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub estimated_seconds: Option<f64>,
    /// What the action code of its turns did, where it brought some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl SubmissionBody {
    /// The body of a stored submission, whose task is in this suite.
    #[must_use]
    pub fn of(row: SubmissionRow, entry: &Entry) -> Self {
        let number = u32::try_from(row.task_number).unwrap_or_default();
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
            turns: row.turns,
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
    /// Its id.
    #[schema(format = Uuid)]
    pub id: String,
    /// True where the run held this very log for the task already; nothing was stored again.
    pub repeated: bool,
    /// What the action code of its turns did, where it brought some.
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
    /// In the order of the lines.
    pub submissions: Vec<AcceptedBody>,
}

/// The answer to a post: for one submission, or for the lines of an NDJSON body.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum AcceptedAnswer {
    /// To a JSON body.
    One(AcceptedBody),
    /// To an NDJSON body.
    Lines(AcceptedList),
}

/// A submission that would be accepted.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Validated {
    /// `name@version` of the task's suite.
    #[schema(example = "mineceraft@2")]
    pub suite: String,
    /// The task's number in it.
    #[schema(example = 113)]
    pub number: u32,
    /// Turns of the log.
    pub turns: usize,
    /// Events of the log.
    pub events: usize,
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// Whether the run holds this very log for the task already.
    pub repeated: bool,
    /// What the action code of its turns did, where it brought some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<TurnReplay>,
}

impl Validated {
    /// Describes a submission that is ready to store.
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
    /// In the order of the body.
    pub submissions: Vec<Validated>,
}
