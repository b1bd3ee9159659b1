//! Parser of requests to grade, which reports all faults at once.

use std::time::Duration;

use serde::de::{IgnoredAny, MapAccess, SeqAccess};
use serde_json::{Map, Value};

use crate::app::limits::LIMITS;
use crate::app::submissions::log_member::LogMember;
use crate::app::submissions::posted::{TaskRef, TaskShape};
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::reward::Scheme;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::tolerant::{OrNull, Read, Scalar, Shape, Text, Verbatim};
use plumbline_engine::tasks::published::read_checks;
use plumbline_engine::tasks::{Instruction, Task};

/// Amount of detail in the response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Detail {
    /// Reward, verdicts, and a score per criterion and check.
    #[default]
    Scores,
    /// The whole report with its evidence as well.
    Report,
}

/// The task of a request to grade.
#[derive(Debug, Clone, PartialEq)]
pub enum NamedTask {
    /// Task of a suite.
    Listed(TaskRef),
    /// Task that the request brings.
    Inline(Box<Task>),
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
    /// Work to grade.
    pub work: GivenWork,
    /// Scheme by which the reward is computed.
    pub scheme: Scheme,
    /// Amount of detail in the response.
    pub detail: Detail,
    /// Time that grading may take.
    pub deadline: Duration,
}

/// Shape of a request to grade.
#[derive(Debug)]
pub struct GradeShape<'f> {
    /// Collector of faults.
    pub faults: &'f mut Faults,
}

const MEMBERS: &str = "a request has task, suite, turns or log or answer, reward, detail and deadline_ms";

impl<'de> Shape<'de> for GradeShape<'_> {
    type Out = GradeRequest;

    fn wanted(&self) -> &'static str {
        "an object with \"task\" and \"turns\" or \"answer\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<GradeRequest>, A::Error> {
        let faults = self.faults;
        let (mut task, mut suite, mut log, mut answer) = (None, None, LogMember::default(), None);
        let (mut scheme, mut detail, mut deadline_ms) = (None, None, None);
        while let Some(key) = members.next_key::<String>()? {
            faults.enter_key(&key);
            match key.as_str() {
                "task" if task.is_none() => task = Some(members.next_value_seed(Read(NamedTaskShape { faults }))?),
                "suite" if suite.is_none() => {
                    let text = Text { faults, min_chars: 1, max_chars: 100 };
                    suite = Some(members.next_value_seed(Read(OrNull(text)))?.flatten());
                }
                "turns" | "log" if !log.is_given() && answer.is_none() => log.read(&key, &mut members, faults)?,
                "answer" if !log.is_given() && answer.is_none() => {
                    answer = members.next_value_seed(Read(OrNull(AnswerTexts { faults })))?.flatten();
                }
                "turns" | "log" | "answer" => log.refuse_second(&mut members, faults)?,
                "reward" if scheme.is_none() => scheme = Some(read_scheme(&members.next_value()?, faults)),
                "detail" if detail.is_none() => detail = Some(read_detail(&members.next_value()?, faults)),
                "deadline_ms" if deadline_ms.is_none() => {
                    deadline_ms = Some(read_deadline(&members.next_value()?, faults));
                }
                "task" | "suite" | "reward" | "detail" | "deadline_ms" => {
                    faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    faults.add(format!("unknown field; {MEMBERS}"));
                    members.next_value::<IgnoredAny>()?;
                }
            }
            faults.leave();
        }
        for (key, is_missing) in [("task", task.is_none()), ("turns", !log.is_given() && answer.is_none())] {
            if is_missing {
                faults.add_at(key, "missing");
            }
        }
        if matches!(task, Some(Some(NamedTask::Inline(_)))) && suite.as_ref().is_some_and(Option::is_some) {
            faults.add_at("suite", "an inline task belongs to no suite; leave suite out");
        }
        let work = answer.flatten().map(GivenWork::Answer).or_else(|| log.sent().map(GivenWork::Log));
        let (Some(Some(task)), Some(work)) = (task, work) else { return Ok(None) };
        let deadline_ms = deadline_ms.unwrap_or(LIMITS.grade_default_deadline_ms);
        Ok(Some(GradeRequest {
            task,
            suite: suite.flatten().flatten(),
            work,
            scheme: scheme.unwrap_or_default(),
            detail: detail.unwrap_or_default(),
            deadline: Duration::from_millis(deadline_ms),
        }))
    }
}

/// Shape of the texts of a model: one string, or a list of strings.
struct AnswerTexts<'f> {
    faults: &'f mut Faults,
}

impl<'de> Shape<'de> for AnswerTexts<'_> {
    type Out = Vec<String>;

    fn wanted(&self) -> &'static str {
        "what the model wrote: a string, or a list of strings"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<Vec<String>> {
        Verbatim { faults: self.faults }.scalar(value).map(|text| vec![text])
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<Vec<String>>, A::Error> {
        let faults = self.faults;
        let mut texts = Vec::new();
        loop {
            faults.enter_index(texts.len());
            let text = elements.next_element_seed(Read(Verbatim { faults }))?;
            faults.leave();
            let Some(text) = text else { break };
            texts.push(text.unwrap_or_default());
        }
        if texts.is_empty() {
            faults.add("expected at least one string");
        }
        Ok(Some(texts))
    }
}

/// Reads a scheme: `"strict"`, `"shaped"`, `"mean"`, or `{"weights": {criterion: weight}}`.
pub fn read_scheme(value: &Value, faults: &mut Faults) -> Scheme {
    match value {
        Value::Null => return Scheme::Strict,
        Value::String(name) if name == "strict" => return Scheme::Strict,
        Value::String(name) if name == "mean" => return Scheme::Mean,
        Value::String(name) if name == "shaped" => return Scheme::Shaped,
        Value::Object(members) if members.len() == 1 && members.get("weights").is_some_and(Value::is_object) => {}
        _ => {
            faults.add("expected \"strict\", \"shaped\", \"mean\" or {\"weights\": {\"material\": 1, …}}");
            return Scheme::Strict;
        }
    }
    faults.enter_key("weights");
    let mut weights = Vec::new();
    for (name, weight) in value["weights"].as_object().into_iter().flatten() {
        let criterion = Criterion::ALL.into_iter().find(|criterion| criterion.name() == name);
        let number = weight.as_f64().filter(|weight| *weight >= 0.0 && weight.is_finite());
        match (criterion, number) {
            (Some(criterion), Some(weight)) => weights.push((criterion, weight)),
            (None, _) => {
                let known = Criterion::ALL.map(Criterion::name).join(", ");
                faults.add_at(name, format!("not a criterion; there are {known}"));
            }
            (_, None) => faults.add_at(name, "expected a number of 0 or more"),
        }
    }
    if faults.is_empty() && weights.iter().all(|(_, weight)| *weight == 0.0) {
        faults.add("no weight is above 0");
    }
    faults.leave();
    Scheme::Weighted(weights)
}

fn read_detail(value: &Value, faults: &mut Faults) -> Detail {
    match value {
        Value::Null => Detail::Scores,
        Value::String(name) if name == "scores" => Detail::Scores,
        Value::String(name) if name == "report" => Detail::Report,
        _ => {
            faults.add("expected \"scores\" or \"report\"");
            Detail::Scores
        }
    }
}

fn read_deadline(value: &Value, faults: &mut Faults) -> u64 {
    let most = LIMITS.grade_max_deadline_ms;
    match value.as_u64() {
        _ if value.is_null() => LIMITS.grade_default_deadline_ms,
        Some(ms) if (1..=most).contains(&ms) => ms,
        _ => {
            faults.add(format!("expected milliseconds, 1 to {most}"));
            most
        }
    }
}

struct NamedTaskShape<'f> {
    faults: &'f mut Faults,
}

impl<'de> Shape<'de> for NamedTaskShape<'_> {
    type Out = NamedTask;

    fn wanted(&self) -> &'static str {
        "a task: its id, its number, or an object with \"turns\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<NamedTask> {
        TaskShape { faults: self.faults }.scalar(value).map(NamedTask::Listed)
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<NamedTask>, A::Error> {
        let mut object = Map::new();
        while let Some((key, value)) = members.next_entry::<String, Value>()? {
            object.insert(key, value);
        }
        let before = self.faults.total();
        let (bytes, most) = (written_bytes(&object), LIMITS.grade_inline_bytes);
        if bytes > most {
            self.faults.add(format!("{bytes} bytes as JSON; at most {most} are allowed"));
            return Ok(None);
        }
        let task = inline_task(&object, self.faults);
        Ok((self.faults.total() == before).then(|| NamedTask::Inline(Box::new(task))))
    }
}

/// Returns the size of an object as JSON, in bytes.
fn written_bytes(object: &Map<String, Value>) -> usize {
    serde_json::to_vec(object).map_or(usize::MAX, |bytes| bytes.len())
}

/// Reads a task as `GET /v1/tasks/{id}` shows it: `turns` with `checks`. Other members are ignored, except `id` and
/// prompts.
fn inline_task(object: &Map<String, Value>, faults: &mut Faults) -> Task {
    let id = object.get("id").and_then(Value::as_str).unwrap_or("inline/task");
    if id.len() > 200 {
        faults.add_at("id", "longer than 200 bytes");
    }
    let mut turns = Vec::new();
    let before = faults.total();
    faults.enter_key("turns");
    match object.get("turns").and_then(Value::as_array) {
        None => faults.add("expected a list of turns, each with \"checks\""),
        Some(list) if list.is_empty() || list.len() > LIMITS.turns => {
            faults.add(format!("{} turns; expected 1 to {}", list.len(), LIMITS.turns));
        }
        Some(list) => {
            for (i, turn) in list.iter().enumerate() {
                faults.enter_index(i);
                turns.push(inline_turn(turn, faults));
                faults.leave();
            }
        }
    }
    let (checks, most) = (turns.iter().map(|turn| turn.checks.len()).sum::<usize>(), LIMITS.grade_inline_checks_in_all);
    if checks > most {
        faults.add(format!("{checks} checks in all; at most {most} are allowed"));
    }
    if faults.total() == before && turns.iter().all(|turn| turn.checks.is_empty()) {
        faults.add("a task needs a check; one without any would be passed by every log");
    }
    faults.leave();
    Task::foreign(id.to_owned(), 0, turns)
}

/// Returns the length of the longest list in the arguments of checks.
fn longest_list(value: &Value, depth: usize) -> usize {
    match value {
        Value::Array(items) => {
            let own = if depth > 0 { items.len() } else { 0 };
            items.iter().map(|item| longest_list(item, depth + 1)).fold(own, usize::max)
        }
        Value::Object(members) => members.values().map(|member| longest_list(member, depth + 1)).max().unwrap_or(0),
        _ => 0,
    }
}

fn inline_turn(turn: &Value, faults: &mut Faults) -> Instruction {
    let prompt = turn.get("prompt").and_then(Value::as_str).unwrap_or_default().to_owned();
    faults.enter_key("checks");
    let mut checks = turn.get("checks").cloned().unwrap_or_default();
    for check in checks.as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut) {
        // Drop the members that the task's own page adds to a check.
        check.remove("criterion");
        check.remove("asks");
    }
    let most = LIMITS.grade_inline_list_items;
    if longest_list(&checks, 0) > most {
        faults.add(format!("a list of more than {most} names in the arguments of a check"));
        checks = Value::Array(Vec::new());
    }
    let checks = read_checks(&checks, faults);
    if checks.len() > LIMITS.grade_inline_checks {
        faults.add(format!("{} checks; at most {} are allowed", checks.len(), LIMITS.grade_inline_checks));
    }
    faults.leave();
    Instruction::new(prompt, checks)
}
