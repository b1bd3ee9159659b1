//! Requests to grade: their body, and what it asks.

use std::ops::RangeInclusive;
use std::time::Duration;

use serde_json::Value;

use super::scheme::{SchemeBody, read_scheme};
use super::task_member::{GivenTaskBody, NamedTask, NamedTaskShape};
use crate::app::body::values::Json;
use crate::app::body::{name, profile, request_body};
use crate::app::limits::LIMITS;
use crate::app::submissions::log_member::{stored_log, turns};
use plumbline_engine::grading::reward::Scheme;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::schema::{NewTurn, StoredLogBody};
use plumbline_engine::intake::tolerant::Texts;
use plumbline_engine::voxel::Profile;

request_body! {
    /// A log to grade synchronously.
    #[schema(example = json!({
        "task": "walls/5x1x5-raise", "reward": "mean",
        "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
    }))]
    pub struct NewGrade: "an object with \"task\" and \"turns\" or \"answer\"" {
        /// The task: its id, its number, or a whole task, which is an object with `turns`, each with `checks` of `fn`
        /// and
        /// `args`.
        #[schema(value_type = GivenTaskBody)]
        task: NamedTask = required(|faults| NamedTaskShape { faults }),
        /// Suite of the task, if it is given by id or number: name, or name@version.
        #[schema(min_length = 1)]
        suite: String = optional(name),
        /// Rules under which the actions become a build. By default those of the suite for action code, and `published`
        /// for plain events.
        profile: Profile = optional(profile),
        /// Turns of the log, as many as the task has. One of `turns`, `log` and `answer` is required.
        #[schema(value_type = Option<Vec<NewTurn>>)]
        turns: SentLog = work(turns),
        /// The log in the stored form, as `/v1/submissions/{id}/log` returns it.
        #[schema(value_type = Option<StoredLogBody>)]
        log: SentLog = work(stored_log),
        /// Text or list of texts from a language model. The last complete answer outside thinking tags counts: a log as
        /// JSON, or action code, in a code fence or bare. Under the profile `mindcraft`, the code is everything from the
        /// first fence to the last, as in mindcraft. If there are several texts, each answers a turn.
        #[schema(value_type = Option<AnswerTextsBody>)]
        answer: Vec<String> = work(|faults| Texts { faults, most: usize::MAX }),
        /// Reward scheme; `strict` by default.
        #[schema(value_type = Option<SchemeBody>)]
        reward: Scheme = optional(|faults| Json { faults, read: read_scheme }),
        /// Level of detail of the response; `scores` by default.
        detail: Detail = optional(|faults| Json { faults, read: read_detail }),
        /// Deadline for grading, in milliseconds; `/v1/limits` has the default and the maximum.
        #[schema(minimum = 1)]
        deadline_ms: u64 = optional(|faults| Json { faults, read: read_deadline }),
    }
    unknown: |key| match key {
        "action_code" | "events" | "palette" | "rows" => "unknown field; it belongs in a turn: \"turns\": [{…}]",
        "messages" | "completion" | "response" | "text" | "output" => "unknown field; send what the model wrote as \"answer\": a string or an array of strings",
        _ => "unknown field; a request has task, suite, profile, turns or log or answer, reward, detail and deadline_ms",
    }
}

/// Amount of detail in the response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Detail {
    /// Reward, verdicts, and a score per criterion and check.
    #[default]
    Scores,
    /// The whole report with its evidence as well.
    Report,
}

/// Work to grade.
#[derive(Debug)]
pub enum GivenWork {
    /// Log, with action code that is yet to be run.
    Log(SentLog),
    /// Text or texts that a language model wrote, in order, in which a log or code is yet to be found.
    Answer(Vec<String>),
}

/// A request to grade a log.
#[derive(Debug)]
pub struct GradeRequest {
    /// Task to grade against.
    pub task: NamedTask,
    /// Name of the suite, for a task of a suite.
    pub suite: Option<String>,
    /// Rules under which the actions become a build, if they were asked for.
    pub profile: Option<Profile>,
    /// Work to grade.
    pub work: GivenWork,
    /// Scheme by which the reward is computed.
    pub scheme: Scheme,
    /// Amount of detail in the response.
    pub detail: Detail,
    /// Time that grading may take.
    pub deadline: Duration,
    /// Time that action code may take, if the request has a deadline; otherwise its own limits end it.
    pub for_code: Option<Duration>,
}

impl GradeRequest {
    /// Takes the request from its body and adds the faults of members that do not go together. Returns `None` if it has no
    /// task or no work that could be read.
    pub fn of(body: NewGrade, faults: &mut Faults) -> Option<Self> {
        if matches!(body.task, Some(NamedTask::Inline(_))) && body.suite.is_some() {
            faults.add_at("suite", "an inline task belongs to no suite; leave suite out");
        }
        let work = body.answer.map(GivenWork::Answer).or_else(|| body.turns.or(body.log).map(GivenWork::Log));
        let asked = body.deadline_ms.map(Duration::from_millis);
        Some(Self {
            task: body.task?,
            suite: body.suite,
            profile: body.profile,
            work: work?,
            scheme: body.reward.unwrap_or_default(),
            detail: body.detail.unwrap_or_default(),
            deadline: asked.unwrap_or(Duration::from_millis(LIMITS.grade_default_deadline_ms)),
            for_code: asked,
        })
    }
}

/// Text that a model wrote.
#[derive(Debug, utoipa::ToSchema)]
#[serde(untagged)]
pub enum AnswerTextsBody {
    /// One text.
    One(String),
    /// Several texts, in order.
    Several(Vec<String>),
}

/// Returns the amount of detail with this name.
pub(super) fn detail_named(name: &str) -> Option<Detail> {
    match name {
        "scores" => Some(Detail::Scores),
        "report" => Some(Detail::Report),
        _ => None,
    }
}

fn read_detail(value: &Value, faults: &mut Faults) -> Option<Detail> {
    let detail = value.as_str().and_then(detail_named);
    if detail.is_none() {
        faults.add("expected \"scores\" or \"report\"");
    }
    detail
}

/// Deadlines that a request may set, in milliseconds.
pub(super) const DEADLINES: RangeInclusive<u64> = 1..=LIMITS.grade_max_deadline_ms;

fn read_deadline(value: &Value, faults: &mut Faults) -> Option<u64> {
    let deadline = value.as_u64().filter(|ms| DEADLINES.contains(ms));
    if deadline.is_none() {
        faults.add(format!("expected milliseconds, 1 to {}", LIMITS.grade_max_deadline_ms));
    }
    deadline
}
