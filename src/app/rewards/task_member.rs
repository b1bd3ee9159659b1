//! The member `task` of a request to grade: a reference to a task of a suite, or a task of its own.

use serde::Deserialize as _;
use serde::de::{MapAccess, Visitor as _};
use serde_json::{Map, Value};

use crate::app::body::free::{FreeJson, Room};
use crate::app::limits::LIMITS;
use crate::app::task_ref::{TaskRef, TaskShape};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{Scalar, Shape};
use plumbline_engine::tasks::published::{add_unknown, read_checks};
use plumbline_engine::tasks::{Instruction, Task};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::Reading;

/// The task of a request to grade.
#[derive(Debug, Clone, PartialEq)]
pub enum NamedTask {
    /// Task of a suite.
    Listed(TaskRef),
    /// Task that the request brings.
    Inline(Box<Task>),
}

/// A task, either of a suite or inline.
#[derive(Debug, utoipa::ToSchema)]
#[serde(untagged)]
pub enum GivenTaskBody {
    /// Identifier of the task.
    Id(String),
    /// Number of the task in the suite.
    Number(u32),
    /// An inline task.
    Whole(InlineTask),
}

/// An inline task, as `GET /v1/tasks/{family}/{instance}` returns it. The other members of that answer are passed over.
#[derive(Debug, utoipa::ToSchema)]
pub struct InlineTask {
    /// Identifier of the task in the response.
    pub id: Option<String>,
    /// How the blocks of a log are read before they are checked.
    #[schema(default = "as_listed")]
    pub reading: Option<Reading>,
    /// Turns of the task.
    #[schema(min_items = 1)]
    pub turns: Vec<InlineTurn>,
}

/// A turn of an inline task.
#[derive(Debug, utoipa::ToSchema)]
pub struct InlineTurn {
    /// Instruction to the agent, for the record.
    pub prompt: Option<String>,
    /// Checks of the structure after the turn.
    pub checks: Vec<InlineCheck>,
}

/// A check of an inline task.
#[derive(Debug, utoipa::ToSchema)]
pub struct InlineCheck {
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schema(example = "shape.has_rooms")]
    pub name: String,
    /// Arguments of the check.
    #[schema(value_type = Option<Object>, example = json!({ "room_cnt": 2 }))]
    pub args: Option<Map<String, Value>>,
}

/// Shape of the task of a request to grade.
#[derive(Debug)]
pub struct NamedTaskShape<'f> {
    /// Collector of faults.
    pub faults: &'f mut Faults,
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

    fn object<A: MapAccess<'de>>(self, members: A) -> Result<Option<NamedTask>, A::Error> {
        let mut room = Room::of_member();
        let Value::Object(object) = FreeJson(&mut room).visit_map(members)? else { unreachable!("a map is an object") };
        if let Some(why) = room.fault() {
            self.faults.add(why);
            return Ok(None);
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

/// Members of a task as `GET /v1/tasks/{family}/{instance}` shows it. Only `id`, `reading` and `turns` are read.
const OF_TASK: [&str; 12] = [
    "id",
    "reading",
    "turns",
    "number",
    "family",
    "category",
    "type",
    "parameters",
    "suite",
    "hash",
    "criteria",
    "unmeasured",
];

/// Members of a turn there. Only `prompt` and `checks` are read.
const OF_TURN: [&str; 4] = ["prompt", "checks", "brief", "informational"];

/// Adds a fault for each member that has none of the names.
fn refuse_others(members: &Map<String, Value>, names: &[&str], faults: &mut Faults) {
    for name in members.keys().filter(|name| !names.contains(&name.as_str())) {
        add_unknown(name, names.iter().copied(), faults);
    }
}

/// Returns a member that is a string. Adds a fault if it is anything else but null.
fn text_of<'v>(members: &'v Map<String, Value>, name: &str, faults: &mut Faults) -> Option<&'v str> {
    let value = members.get(name).filter(|value| !value.is_null())?;
    if !value.is_string() {
        faults.add_at(name, "expected a string");
    }
    value.as_str()
}

/// Reads how blocks are read. Adds a fault if there is no such reading.
fn reading_of(object: &Map<String, Value>, faults: &mut Faults) -> Reading {
    let named = object.get("reading").filter(|value| !value.is_null());
    let reading = named.map(Reading::deserialize).transpose();
    if reading.is_err() {
        faults.add_at("reading", "expected \"as_listed\" or \"game\"");
    }
    reading.ok().flatten().unwrap_or_default()
}

/// Reads a task as `GET /v1/tasks/{family}/{instance}` shows it: `id`, `reading`, and `turns` with `prompt` and `checks`.
fn inline_task(object: &Map<String, Value>, faults: &mut Faults) -> Task {
    refuse_others(object, &OF_TASK, faults);
    let id = text_of(object, "id", faults).unwrap_or("inline/task");
    if id.chars().count() > LIMITS.task_chars {
        faults.add_at("id", format!("longer than {} characters", LIMITS.task_chars));
    }
    let reading = reading_of(object, faults);
    let mut turns = Vec::new();
    let before = faults.total();
    faults.enter_key("turns");
    match object.get("turns").and_then(Value::as_array) {
        None => faults.add("expected an array of turns, each with \"checks\""),
        Some(list) if list.is_empty() || list.len() > LIMITS.turns => {
            faults.add(format!("{}; expected 1 to {}", counted(list.len(), "turn"), LIMITS.turns));
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
        faults.add(format!("{} in all; at most {most} are allowed", counted(checks, "check")));
    }
    if faults.total() == before && turns.iter().all(|turn| turn.checks.is_empty()) {
        faults.add("a task needs a check; one without any would be passed by every log");
    }
    faults.leave();
    Task { reading, ..Task::foreign(id.to_owned(), 0, turns) }
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
    let Some(members) = turn.as_object() else {
        faults.add("expected an object with \"checks\"");
        return Instruction::new(String::new(), Vec::new());
    };
    refuse_others(members, &OF_TURN, faults);
    let prompt = text_of(members, "prompt", faults).unwrap_or_default().to_owned();
    faults.enter_key("checks");
    let mut checks = turn.get("checks").cloned().unwrap_or_default();
    for check in checks.as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut) {
        // Drop the members that the task's own page adds to a check.
        check.remove("criterion");
        check.remove("asks");
        // Tables of data give each row the members of all: what is null there is absent.
        if let Some(args) = check.get_mut("args").and_then(Value::as_object_mut) {
            args.retain(|_, value| !value.is_null());
        }
    }
    let most = LIMITS.grade_inline_list_items;
    if longest_list(&checks, 0) > most {
        faults.add(format!("an array of more than {most} names in the arguments of a check"));
        checks = Value::Array(Vec::new());
    }
    let (sent, most) = (checks.as_array().map_or(0, Vec::len), LIMITS.grade_inline_checks);
    if sent > most {
        faults.add(format!("{}; at most {most} are allowed", counted(sent, "check")));
        checks = Value::Array(Vec::new());
    }
    let checks = read_checks(&checks, faults);
    faults.leave();
    Instruction::new(prompt, checks)
}
