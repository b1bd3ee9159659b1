//! Answers as models write them, replayed under the profile `mindcraft` and compared with what was derived by reading
//! (`answers/README.md`).

use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::support::{PROGRAM, Service, repository};

/// What an answer must come to.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Expected {
    why: String,
    events: Option<Vec<Value>>,
    event_count: Option<usize>,
    structure: Option<Vec<Value>>,
    structure_count: Option<usize>,
    #[serde(default)]
    structure_includes: Vec<Value>,
    ended_early: bool,
    error_contains: Option<String>,
    #[serde(default)]
    notes_contain: Vec<String>,
}

fn cases() -> Vec<(String, Vec<PathBuf>, Expected)> {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(repository("tests/actions/answers"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    let case = |folder: PathBuf| {
        let number = |path: &Path| path.file_stem()?.to_str()?.parse::<u32>().ok();
        let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| number(path).is_some())
            .collect();
        files.sort_by_key(|path| number(path));
        let expected = std::fs::read(folder.join("expected.json")).unwrap();
        let name = folder.file_name().unwrap().to_str().unwrap().to_owned();
        let expected = serde_json::from_slice(&expected).unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, files, expected)
    };
    folders.into_iter().map(case).collect()
}

/// Adds what differs from what was expected.
fn compare(name: &str, expected: &Expected, events: &[Value], structure: &[Value], wrong: &mut Vec<String>) {
    let by_place = |blocks: &[Value]| {
        let mut blocks = blocks.to_vec();
        blocks.sort_by_key(|block| ["y", "x", "z"].map(|axis| block[axis].as_i64()));
        blocks
    };
    let mut told = |what: &str, is_right: bool| {
        if !is_right {
            wrong.push(format!("{name}: {what} ({})\n  events {events:?}\n  structure {structure:?}", expected.why));
        }
    };
    told("events", expected.events.as_deref().is_none_or(|wanted| wanted == events));
    told("number of events", expected.event_count.is_none_or(|wanted| wanted == events.len()));
    told("structure", expected.structure.as_deref().is_none_or(|wanted| by_place(wanted) == by_place(structure)));
    told("size of the structure", expected.structure_count.is_none_or(|wanted| wanted == structure.len()));
    told("blocks of the structure", expected.structure_includes.iter().all(|block| structure.contains(block)));
}

fn without_states(events: impl Iterator<Item = Value>) -> Vec<Value> {
    let bare = |mut event: Value| {
        event.as_object_mut().unwrap().remove("block");
        event
    };
    events.map(bare).collect()
}

#[test]
fn the_command_builds_what_a_bot_would_have_built() {
    let mut wrong = Vec::new();
    let cases = cases();
    assert!(cases.len() >= 120);
    for (name, files, expected) in &cases {
        let replay = |options: &[&str]| {
            let output =
                Command::new(PROGRAM).args(["replay", "--profile", "mindcraft"]).args(options).args(files).output();
            let output = output.unwrap();
            let lines: Vec<Value> = String::from_utf8(output.stdout)
                .unwrap()
                .lines()
                .map(|line| serde_json::from_str(line).unwrap())
                .collect();
            (lines, String::from_utf8(output.stderr).unwrap(), output.status.code())
        };
        let (events, told, code) = replay(&[]);
        let (structure, _, structure_code) = replay(&["--structure"]);
        compare(name, expected, &without_states(events.into_iter()), &structure, &mut wrong);
        let wanted: &[i32] = if expected.ended_early { &[3, 1] } else { &[0] };
        if !wanted.contains(&code.unwrap()) || structure_code != code {
            wrong.push(format!("{name}: exit code {code:?}: {told}"));
        }
        for part in expected.error_contains.iter().chain(&expected.notes_contain) {
            if !told.contains(part.as_str()) {
                wrong.push(format!("{name}: {part:?} is not told: {told}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[tokio::test]
async fn the_service_answers_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    let mut wrong = Vec::new();
    for (name, files, expected) in cases() {
        let texts: Vec<String> = files.iter().map(|file| std::fs::read_to_string(file).unwrap()).collect();
        let code = if let [one] = texts.as_slice() { json!(one) } else { json!(texts) };
        let answer = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": code })).await;
        assert_eq!(answer.status, 200, "{name}: {}", answer.text);
        let told = answer.json();
        let events = without_states(told["events"].as_array().unwrap().iter().cloned());
        compare(&name, &expected, &events, told["structure"].as_array().unwrap(), &mut wrong);
        if told["error"].is_null() == expected.ended_early {
            wrong.push(format!("{name}: error {}", told["error"]));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
