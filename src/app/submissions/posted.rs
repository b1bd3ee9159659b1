//! Bodies of submissions, JSON or NDJSON.

use super::log_member::{stored_log, turns};
use crate::actions::turn_replay::TurnReplay;
use crate::app::body::{name, profile, read_body, request_body};
use crate::app::limits::LIMITS;
use crate::app::task_ref::{TaskRef, TaskShape};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::not_json::{on_its_line, why_not_json};
use plumbline_engine::intake::schema::{NewTurn, StoredLogBody};
use plumbline_engine::voxel::Profile;

/// Format of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One JSON document.
    Json,
    /// One JSON document per line.
    NdJson,
}

request_body! {
    /// An agent's work on one task.
    #[schema(example = json!({
        "task": "walls/5x1x5-raise",
        "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
    }))]
    pub struct NewSubmissionBody: "an object with \"task\", \"turns\" and, for a board, \"run\"" {
        /// Run that the submission belongs to. Without a run it is graded all the same, but appears on no board.
        #[schema(format = Uuid)]
        run: String = optional(name),
        /// Suite of the task, if the submission belongs to no run: name, or name@version.
        #[schema(min_length = 1)]
        suite: String = optional(name),
        /// The task: its id, or its number in the suite (the `run_idx` of published records).
        #[schema(value_type = TaskRef)]
        task: TaskRef = required(|faults| TaskShape { faults }),
        /// Rules under which the actions become a build. By default those of the suite for action code, and `published`
        /// for plain events.
        profile: Profile = optional(profile),
        /// Turns of the log, as many as the task has. Either `turns` or `log` is required.
        #[schema(value_type = Option<Vec<NewTurn>>)]
        turns: SentLog = work(turns),
        /// The log in the stored form, as `/v1/submissions/{id}/log` returns it.
        #[schema(value_type = Option<StoredLogBody>)]
        log: SentLog = work(stored_log),
    }
    unknown: |key| match key {
        "action_code" | "events" | "palette" | "rows" => "unknown field; it belongs in a turn: \"turns\": [{…}]",
        "answer" => "unknown field; a submission takes turns or log, and only /v1/grade takes answer",
        _ => "unknown field; a submission has run, suite, task, profile and turns or log",
    }
}

impl NewSubmissionBody {
    /// Returns the submission, unless its task or its log could not be read.
    fn posted(self, line: Option<u64>) -> Option<PostedSubmission> {
        let Self { run, suite, task, profile, turns, log } = self;
        Some(PostedSubmission { line, run, suite, task: task?, profile, sent: turns.or(log)?, replays: Vec::new() })
    }
}

/// Submission as posted.
#[derive(Debug)]
pub struct PostedSubmission {
    /// Line in an NDJSON body, from 1.
    pub line: Option<u64>,
    /// Run that the submission belongs to.
    pub run: Option<String>,
    /// Suite of the task, if the submission belongs to no run.
    pub suite: Option<String>,
    /// Reference to the task.
    pub task: TaskRef,
    /// Rules that were asked for.
    pub profile: Option<Profile>,
    /// Log, with action code that is yet to be run.
    pub sent: SentLog,
    /// Results of the action code, once it was run.
    pub replays: Vec<TurnReplay>,
}

impl PostedSubmission {
    /// Sets the rules of the log: those that were asked for, or else for action code those of the suite.
    pub fn choose_profile(&mut self, of_suite: Option<Profile>) {
        self.sent.choose_profile(self.profile, of_suite);
    }
}

/// Submissions read from a body.
#[derive(Debug)]
pub struct Posted {
    /// Submissions that could be read; faulty ones are left out.
    pub submissions: Vec<PostedSubmission>,
    /// Whether the body, or a line of it, is not JSON.
    pub is_malformed: bool,
}

/// Reads all submissions of a body and adds every fault to `faults`. Looking up names may add more faults later.
#[must_use]
pub fn read_submissions(text: &[u8], format: Format, faults: &mut Faults) -> Posted {
    let mut posted = Posted { submissions: Vec::new(), is_malformed: false };
    match format {
        Format::Json => posted.read(text, None, faults),
        Format::NdJson => posted.read_lines(text, faults),
    }
    posted
}

impl Posted {
    fn read(&mut self, text: &[u8], line: Option<u64>, faults: &mut Faults) {
        match read_body::<NewSubmissionBody>(text, faults) {
            Ok(body) => self.submissions.extend(body.and_then(|body| body.posted(line))),
            Err(error) => {
                self.is_malformed = true;
                faults.add(match line {
                    None => why_not_json(text, &error),
                    Some(_) => on_its_line(text, &error),
                });
            }
        }
    }

    fn read_lines(&mut self, text: &[u8], faults: &mut Faults) {
        let lines = (1u64..).zip(text.split(|byte| *byte == b'\n'));
        let mut filled = lines.filter(|(_, line)| !line.iter().all(u8::is_ascii_whitespace)).peekable();
        if filled.peek().is_none() {
            self.is_malformed = true;
            faults.add("the body has no lines");
        }
        if is_one_over_lines(text) {
            self.is_malformed = true;
            faults.add(if text.trim_ascii_start().starts_with(b"[") {
                "one JSON list over several lines; NDJSON has one document in each line, without brackets or commas around them"
            } else {
                "one JSON document over several lines; NDJSON has one document in each line; send this one as application/json"
            });
            return;
        }
        for (count, (line, text)) in filled.enumerate() {
            faults.enter_line(line);
            if count >= LIMITS.ndjson_lines {
                faults.add(format!("more than {} submissions in one body", LIMITS.ndjson_lines));
                break;
            }
            self.read(text, Some(line), faults);
        }
    }
}

/// Returns whether a text is a single JSON document over several lines, of which the first alone is not one.
fn is_one_over_lines(text: &[u8]) -> bool {
    let is_json = |text: &[u8]| serde_json::from_slice::<serde::de::IgnoredAny>(text).is_ok();
    let first = text.trim_ascii_start().split(|byte| *byte == b'\n').next().unwrap_or_default();
    matches!(first.trim_ascii(), b"{" | b"[") && is_json(text)
}
