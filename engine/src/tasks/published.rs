//! Task files in the published format (`docs/rules.md#formats`), which is a JSON list of items, each with wordings and
//! checks per turn.

use serde_json::{Map, Value};

use super::{Instruction, Task};
use crate::checks::Check;
use crate::intake::not_json::message;
use crate::intake::{Fault, Faults};
use crate::text::{counted, did_you_mean, reworded};

/// Text of a task file.
#[derive(Debug, Clone, Copy)]
pub struct TaskFile<'a> {
    /// File name with its extension. Tasks are numbered in the byte order of the file names.
    pub name: &'a str,
    /// Content of the file.
    pub text: &'a str,
}

/// A fault in a task file and its location.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {fault}")]
pub struct TaskFileFault {
    /// Name of the faulty file.
    pub file: String,
    /// Location and reason. In JSON files only syntax errors have a line.
    pub fault: Fault,
}

/// Reads task files and numbers their problems from 1, ordered by file name, then item, then wording.
///
/// # Errors
/// Returns all faults of all files.
pub fn read_task_files(files: &[TaskFile<'_>]) -> Result<Vec<Task>, Vec<TaskFileFault>> {
    let mut ordered = files.to_vec();
    ordered.sort_by_key(|file| file.name.as_bytes());
    let mut tasks = Vec::new();
    let mut problems = Vec::new();
    for file in ordered {
        let mut faults = Faults::new();
        let family = family_name(file.name);
        if tasks.iter().any(|task: &Task| task.family() == family) {
            faults.add(format!("another file has the same family name {family:?}"));
        }
        match serde_json::from_str::<Value>(file.text) {
            Err(error) => {
                let fault = Fault {
                    line: u64::try_from(error.line()).ok(),
                    pointer: String::new(),
                    detail: format!("not JSON: {}", message(&error)),
                };
                problems.push(TaskFileFault { file: file.name.to_owned(), fault });
            }
            Ok(value) => read_items(&value, &family, &mut tasks, &mut faults),
        }
        problems
            .extend(faults.into_list().into_iter().map(|fault| TaskFileFault { file: file.name.to_owned(), fault }));
    }
    if problems.is_empty() { Ok(tasks) } else { Err(problems) }
}

/// Returns the family of a file: its name without the extension, with one dash in place of each run of characters other
/// than letters, digits, dots and underscores, so that ids need no escaping.
fn family_name(file_name: &str) -> String {
    let stem = file_name.strip_suffix(".json").unwrap_or(file_name);
    let words = stem.split(|c: char| !c.is_ascii_alphanumeric() && c != '.' && c != '_');
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

fn read_items(value: &Value, family: &str, tasks: &mut Vec<Task>, faults: &mut Faults) {
    let Some(items) = array(value, "an array of items", faults) else { return };
    if items.is_empty() {
        faults.add("the file has no items");
    }
    for (i, item) in items.iter().enumerate() {
        faults.enter_index(i);
        read_item(item, family, i + 1, tasks, faults);
        faults.leave();
    }
}

fn read_item(item: &Value, family: &str, item_number: usize, tasks: &mut Vec<Task>, faults: &mut Faults) {
    let Some(item) = object(item, &["prompts", "checks"], &["_comment"], faults) else { return };
    faults.enter_key("checks");
    let checks = read_turns(&item["checks"], faults);
    if item["checks"].as_array().is_some_and(Vec::is_empty) {
        faults.add("no turns");
    }
    faults.leave();
    faults.enter_key("prompts");
    if item["prompts"].as_array().is_some_and(Vec::is_empty) {
        faults.add("no wordings");
    }
    for (w, wording) in array(&item["prompts"], "an array of wordings", faults).into_iter().flatten().enumerate() {
        faults.enter_index(w);
        let prompts = read_prompts(wording, checks.len(), faults);
        faults.leave();
        let turns = prompts.into_iter().zip(&checks);
        let number = u32::try_from(tasks.len() + 1).unwrap_or(u32::MAX);
        let id = format!("{family}/{item_number:02}-w{}", w + 1);
        let turns = turns.map(|(prompt, checks)| Instruction::new(prompt, checks.clone()));
        tasks.push(Task::foreign(id, number, turns.collect()));
    }
    faults.leave();
}

fn read_prompts(wording: &Value, turns: usize, faults: &mut Faults) -> Vec<String> {
    let Some(prompts) = array(wording, "an array of prompts, one per turn", faults) else { return Vec::new() };
    if prompts.len() != turns {
        faults.add(format!("{} for {} of checks", counted(prompts.len(), "prompt"), counted(turns, "turn")));
    }
    let mut texts = Vec::new();
    for (t, prompt) in prompts.iter().enumerate() {
        if let Some(text) = prompt.as_str() {
            texts.push(text.to_owned());
        } else {
            faults.enter_index(t);
            faults.add("expected a string");
            faults.leave();
        }
    }
    texts
}

fn read_turns(turns: &Value, faults: &mut Faults) -> Vec<Vec<Check>> {
    let mut all = Vec::new();
    for (t, turn) in array(turns, "an array of turns", faults).into_iter().flatten().enumerate() {
        faults.enter_index(t);
        all.push(read_checks(turn, faults));
        faults.leave();
    }
    all
}

/// Reads the checks of one turn as task files and raw records list them. Adds each fault at its location.
pub fn read_checks(turn: &Value, faults: &mut Faults) -> Vec<Check> {
    let mut checks = Vec::new();
    for (c, check) in array(turn, "an array of checks", faults).into_iter().flatten().enumerate() {
        faults.enter_index(c);
        checks.extend(read_check(check, faults));
        faults.leave();
    }
    checks
}

/// Reads one check, `{"fn": name, "args": {…}}`. Returns `None` after adding a fault if it cannot be read.
pub fn read_check(check: &Value, faults: &mut Faults) -> Option<Check> {
    let members = object(check, &["fn"], &["args"], faults)?;
    let Some(name) = members["fn"].as_str() else {
        faults.add_at("fn", "expected the name of a check");
        return None;
    };
    let none = Map::new();
    let args = match members.get("args") {
        None | Some(Value::Null) => &none,
        Some(Value::Object(args)) => args,
        Some(_) => {
            faults.add_at("args", "expected an object with the arguments by their names");
            return None;
        }
    };
    match Check::read(name, args) {
        None => {
            faults.add_at("fn", format!("no check is called {name:?}{}", near_checks(name, faults)));
            None
        }
        Some(Ok(check)) => Some(check),
        Some(Err(error)) => {
            faults.enter_key("args");
            add_wrong_argument(name, &error, faults);
            faults.leave();
            None
        }
    }
}

/// Suggests checks for a name that none has, be it misspelt or without its group.
fn near_checks(name: &str, faults: &Faults) -> String {
    if faults.are_full() {
        return String::new();
    }
    let short = |full: &'static str| full.split_once('.').map_or(full, |(_, short)| short);
    let names = || Check::LIST.iter().map(|(full, _)| *full);
    if let Some(full) = names().find(|full| short(full) == name) {
        return format!("; did you mean {full}?");
    }
    did_you_mean(name, names())
}

/// Adds a fault of an argument at its place.
fn add_wrong_argument(check: &str, error: &serde_path_to_error::Error<serde_json::Error>, faults: &mut Faults) {
    let why = error.inner().to_string();
    // The names that are known stand in backticks after the one that is not, which may hold anything.
    let (_, known) = why.rsplit_once(", expected ").unwrap_or(("", ""));
    let others: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
    let last = error.path().iter().next_back().map(ToString::to_string).unwrap_or_default();
    let missing = why.strip_prefix("missing field `").map_or("", |rest| rest.trim_end_matches('`'));
    let text = if why.starts_with("missing field") {
        format!("missing; {check} needs it")
    } else if why.starts_with("unknown field") && faults.are_full() {
        format!("{check} has no such argument")
    } else if why.starts_with("unknown field") && others.is_empty() {
        format!("{check} takes no arguments")
    } else if why.starts_with("unknown field") {
        let near = did_you_mean(&last, others.iter().copied());
        let known = if near.is_empty() { format!("; it takes {}", others.join(", ")) } else { near };
        format!("{check} has no such argument{known}")
    } else {
        format!("{} ({check})", reworded(&why))
    };
    let depth = faults.enter_path(error.path());
    // The path ends at an unknown argument, but at the object that lacks one.
    if why.starts_with("missing field") {
        faults.add_at(missing, text);
    } else {
        faults.add(text);
    }
    faults.leave_to(depth);
}

fn array<'a>(value: &'a Value, wanted: &str, faults: &mut Faults) -> Option<&'a Vec<Value>> {
    let array = value.as_array();
    if array.is_none() {
        faults.add(format!("expected {wanted}"));
    }
    array
}

/// Adds a fault for a member with a name that is not known, with those that are similar.
pub fn add_unknown<'n>(name: &str, known: impl IntoIterator<Item = &'n str>, faults: &mut Faults) {
    let near = if faults.are_full() { String::new() } else { did_you_mean(name, known) };
    faults.add_at(name, format!("unknown field{near}"));
}

fn object<'a>(
    value: &'a Value,
    required: &[&str],
    optional: &[&str],
    faults: &mut Faults,
) -> Option<&'a Map<String, Value>> {
    let Some(members) = value.as_object() else {
        faults.add(format!("expected an object with {}", required.join(", ")));
        return None;
    };
    for key in members.keys() {
        if !required.contains(&key.as_str()) && !optional.contains(&key.as_str()) {
            add_unknown(key, required.iter().chain(optional).copied(), faults);
        }
    }
    let missing: Vec<&&str> = required.iter().filter(|key| !members.contains_key(**key)).collect();
    for key in &missing {
        faults.add_at(key, "missing");
    }
    missing.is_empty().then_some(members)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn faults_name_file_and_place() {
        let text = r#"[{"prompts": [["a"], ["b", "c"]], "checks": [[
            {"fn": "shape.has_rooms", "args": {"rooms": 2}},
            {"fn": "shape.has_room", "args": {}},
            {"fn": "size.is_equal", "args": {"xz": [1]}}
        ]], "extra": 1}]"#;
        let faults = read_task_files(&[TaskFile { name: "x.json", text }]).unwrap_err();
        let told: Vec<String> = faults.iter().map(ToString::to_string).collect();
        assert_eq!(told.len(), 5, "{told:#?}");
        assert!(told[0].starts_with("x.json: /0/extra: unknown field"), "{told:#?}");
        assert!(told[1].contains("/0/checks/0/0/args") && told[1].contains("rooms"), "{told:#?}");
        assert!(told[2].contains("/0/checks/0/1/fn"), "{told:#?}");
        assert!(told[3].contains("/0/checks/0/2/args"), "{told:#?}");
        assert!(told[4].contains("/0/prompts/1: 2 prompts for 1 turn "), "{told:#?}");
    }

    /// Reads a check and returns its faults.
    fn told(check: &Value) -> Vec<String> {
        let mut faults = Faults::new();
        let read = read_check(check, &mut faults);
        assert!(read.is_some() || !faults.is_empty(), "{check}");
        faults.into_list().iter().map(|fault| format!("{}: {}", fault.pointer, fault.detail)).collect()
    }

    #[test]
    fn faults_of_a_check_name_the_argument_and_the_remedy() {
        let cases = [
            (
                json!({ "fn": "shape.has_exti" }),
                "/fn: no check is called \"shape.has_exti\"; did you mean shape.has_exit, shape.has_rooms?",
            ),
            (json!({ "fn": "has_exit" }), "/fn: no check is called \"has_exit\"; did you mean shape.has_exit?"),
            (json!({ "fnn": "shape.has_exit", "fn": "shape.has_exit" }), "/fnn: unknown field; did you mean fn?"),
            (
                json!({ "fn": "shape.has_exit", "args": [16, 15, 16, null] }),
                "/args: expected an object with the arguments by their names",
            ),
            (
                json!({ "fn": "shape.has_exit", "args": { "height": 99 } }),
                "/args/height: 99 is out of range: 1 to 16 cells (shape.has_exit)",
            ),
            (
                json!({ "fn": "shape.has_exit", "args": { "hight": 9 } }),
                "/args/hight: shape.has_exit has no such argument; did you mean height?",
            ),
            (
                json!({ "fn": "shape.has_exit", "args": { "q": 9 } }),
                "/args/q: shape.has_exit has no such argument; it takes width, depth, height, start_material",
            ),
            (json!({ "fn": "shape.has_rooms" }), "/args/room_cnt: missing; shape.has_rooms needs it"),
            (
                json!({ "fn": "shape.has_rooms", "args": { "room_cnt": "two" } }),
                "/args/room_cnt: expected a number, found string (shape.has_rooms)",
            ),
            (
                json!({ "fn": "size.is_equal", "args": { "xz": [1, "2"] } }),
                "/args/xz/1: expected a number, found string (size.is_equal)",
            ),
            (
                json!({ "fn": "shape.is_top_surface_concave", "args": { "strict": "non flat" } }),
                "/args/strict: expected true, false or \"non-flat\" (shape.is_top_surface_concave)",
            ),
            (
                json!({ "fn": "shape.are_doors_passable", "args": { "q": 1 } }),
                "/args/q: shape.are_doors_passable takes no arguments",
            ),
        ];
        let (checks, expected): (Vec<Value>, Vec<&str>) = cases.into_iter().unzip();
        let all: Vec<String> = checks.iter().flat_map(told).collect();
        assert_eq!(all, expected, "{all:#?}");
        assert!(told(&json!({ "fn": "shape.has_exit", "args": null })).is_empty());
    }

    #[test]
    fn problems_are_numbered_by_file_name_then_item_then_wording() {
        let two = r#"[{"prompts": [["a"], ["b"]], "checks": [[]]}]"#;
        let one = r#"[{"prompts": [["c"]], "checks": [[]]}]"#;
        let files = [TaskFile { name: "arch.json", text: one }, TaskFile { name: "arch-stress(2).json", text: two }];
        let tasks = read_task_files(&files).unwrap();
        let ids: Vec<_> = tasks.iter().map(|task| (task.number, task.id.as_str())).collect();
        assert_eq!(ids, [(1, "arch-stress-2/01-w1"), (2, "arch-stress-2/01-w2"), (3, "arch/01-w1")]);
    }
}
