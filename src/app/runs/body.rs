//! The bodies that create and finish a run.

use serde::de::SeqAccess;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::embargo::{NewEmbargo, read_embargo};
use crate::app::boards::actions::{REASON_WANTED, trimmed};
use crate::app::body::values::{Json, Parsed};
use crate::app::body::{agent_name, name, request_body};
use crate::app::cards::card::Card;
use crate::app::cards::reading::read_card;
use crate::app::limits::LIMITS;
use crate::app::task_ref::{TaskRef, TaskShape};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{Read, Scalar, Shape};
use plumbline_engine::tasks::Track;

request_body! {
    /// Body that creates a run.
    #[schema(example = json!({ "agent": "my-agent 1.2", "suite": "mineceraft", "metadata": { "model": "m-7b" } }))]
    pub struct NewRunBody: "an object with \"agent\" and \"suite\"" {
        /// Name of the agent, as the board shows it.
        #[schema(value_type = String, min_length = 1)]
        agent: String = required(agent_name),
        /// Suite: name, or name@version.
        #[schema(value_type = String, min_length = 1)]
        suite: String = required(name),
        /// Other information worth keeping, as an object.
        #[schema(value_type = Option<Object>)]
        metadata: Value = optional(|faults| Json { faults, read: read_metadata }),
        /// Origin of its logs; `self-reported` by default. `re-run-by-host` needs the scope `admin`.
        provenance: RunProvenance = optional(|faults| Parsed { text: name(faults), parse: RunProvenance::named }),
        /// Track of its prompts, `specified` by default; only runs of one track are compared.
        #[schema(value_type = Option<Track>)]
        track: Track = optional(|faults| Parsed { text: name(faults), parse: track_named }),
        /// What the run is; it may be edited later.
        card: Card = optional(|faults| Json { faults, read: read_card }),
        /// Embargo: until its end the run shows an alias instead of its agent, and neither owner, card nor metadata.
        /// Its end is public from the beginning and cannot be moved; the owner may lift the embargo earlier.
        embargo: NewEmbargo = optional(|faults| Json { faults, read: read_embargo }),
    }
    unknown: |_| "unknown field; a run has agent, suite, metadata, provenance, track, card and embargo"
}

/// Finds the track with this name.
fn track_named(name: &str) -> Result<Track, String> {
    Track::named(name).ok_or_else(|| format!("expected one of {}", Track::ALL.map(Track::name).join(", ")))
}

fn read_metadata(value: &Value, faults: &mut Faults) -> Option<Value> {
    if !value.is_object() {
        faults.add("expected an object");
    } else if value.to_string().len() > LIMITS.metadata_bytes {
        faults.add(format!("larger than {} bytes", LIMITS.metadata_bytes));
    } else {
        return Some(value.clone());
    }
    None
}

/// Origin of the logs of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RunProvenance {
    /// The owner of the run reports them.
    SelfReported,
    /// The operator of the service re-ran the agent.
    ReRunByHost,
}

/// Profile of the submissions of a run, for the contract.
#[derive(Debug, utoipa::ToSchema)]
#[schema(as = RunProfile)]
#[serde(rename_all = "snake_case")]
pub enum RunProfile {
    /// All have the profile `published`.
    Published,
    /// All have the profile `mindcraft`.
    Mindcraft,
    /// Some have another profile than others.
    Mixed,
}

impl RunProvenance {
    /// All variants.
    pub const ALL: [Self; 2] = [Self::SelfReported, Self::ReRunByHost];

    /// Returns the name in the API.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SelfReported => "self-reported",
            Self::ReRunByHost => "re-run-by-host",
        }
    }
    /// Finds the origin with this name in the API.
    fn named(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|known| known.name() == name);
        found.ok_or_else(|| format!("expected one of {}", Self::ALL.map(Self::name).join(", ")))
    }
}

request_body! {
    /// Body that finishes a run.
    #[derive(Default)]
    #[schema(example = json!({ "skip": "unanswered" }))]
    pub struct FinishBody: "an object with \"skip\"" {
        /// Tasks that are skipped on purpose. They count as failed, and as covered: a run that covers too little of its
        /// suite is not compared with others on the board. A task whose grading failed (`grader_error`) is not `unanswered`:
        /// its run stays `finishing` until it is graded, or until its owner skips it by name.
        #[schema(value_type = Option<SkipBody>)]
        skip: SkipRequest = optional(|faults| SkipShape { faults }),
    }
    unknown: |_| "unknown field; the body has only skip"
}

request_body! {
    /// Withdrawal of a run.
    #[schema(as = NewWithdrawal, example = json!({ "reason": "the harness cut answers off; a new run follows" }))]
    pub struct WithdrawalBody: "an object with \"reason\"" {
        /// Reason for the withdrawal; it is public.
        #[schema(value_type = String, min_length = 1)]
        reason: String = required(|faults| Json { faults, read: read_reason }),
    }
    unknown: |_| "unknown field; a withdrawal has reason"
}

/// Reads a public reason, which may have several lines.
fn read_reason(value: &Value, faults: &mut Faults) -> Option<String> {
    let reason = value.as_str().and_then(trimmed);
    if reason.is_none() {
        faults.add(REASON_WANTED);
    }
    reason
}

/// Tasks that a run skips.
#[derive(Debug, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SkipBody {
    /// All tasks without a submission.
    All(SkipAll),
    /// The listed tasks.
    Tasks(Vec<TaskRef>),
}

/// Name for all tasks without a submission.
#[derive(Debug, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SkipAll {
    /// Tasks without a submission.
    Unanswered,
}

/// Tasks that a run skips on purpose.
#[derive(Debug)]
pub enum SkipRequest {
    /// All tasks without a submission.
    Unanswered,
    /// The listed tasks; none where an item of the list is faulty.
    Tasks(Vec<Option<TaskRef>>),
}

/// Shape of the tasks that a run skips: a word for all that are unanswered, or a list.
struct SkipShape<'f> {
    faults: &'f mut Faults,
}

impl<'de> Shape<'de> for SkipShape<'_> {
    type Out = SkipRequest;

    fn wanted(&self) -> &'static str {
        "\"unanswered\", or an array of tasks"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<SkipRequest> {
        if *value == Scalar::Text("unanswered") {
            return Some(SkipRequest::Unanswered);
        }
        self.faults.add(format!("expected {}, found {value}", self.wanted()));
        None
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<SkipRequest>, A::Error> {
        let faults = self.faults;
        let mut tasks = Vec::new();
        loop {
            faults.enter_index(tasks.len());
            let task = elements.next_element_seed(Read(TaskShape { faults }))?;
            faults.leave();
            let Some(task) = task else { break };
            tasks.push(task);
        }
        Ok(Some(SkipRequest::Tasks(tasks)))
    }
}
