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

/// Answers that mean harm, or break what they are given.
const HOSTILE: [&str; 22] = [
    "````js\nawait skills.placeBlock(bot, 'stone', 0, 0, 0);",
    "```",
    "bot.chat('/fill -30000000 -64 -30000000 29999999 319 29999999 stone');",
    "bot.chat('/gamerule commandModificationBlockLimit 2000000000'); bot.chat('/fill 0 0 0 999 255 999 stone');",
    "bot.chat('/clone 0 0 0 10 0 0 29999995 0 0');",
    "bot.chat('/' + 'execute run '.repeat(2000) + 'say hi');",
    "bot.chat('/setblock 0 0 0 stone' + '['.repeat(100000));",
    "for (let i = 0; i < 1e6; i++) console.log('x'.repeat(1000));",
    "for (let i = 0; i < 20000; i++) bot['name' + (i % 7)];",
    "for (let i = 0; i < 300; i++) bot.chat('/setblock 0 0 0 x' + i);",
    "bot.chat('/fill 0 0 0 31 31 31 stone'); for (let i = 0; i < 50; i++) world.getNearestBlocks(bot, 'stone', 1e9, 1e9);",
    "world.getNearestBlocks(bot, 'dirt', 1e9, 1e9); bot.findBlocks({ matching: () => false, maxDistance: 1e9, count: 1e9 });",
    "Map.prototype.get = () => ({ defaultState: 65535 }); bot.findBlocks({ matching: () => true });",
    "String.prototype.replace = () => 'y'.repeat(3e6); await skills.placeBlock(bot, 'torch', 0, 0, 0, 'north');",
    "const e = new TypeError('not a function'); e.stack = 'at f (action.js:0:1)'; throw e;",
    "log(bot, 'a\\uD800b'); await skills.placeBlock(bot, '\\uD800', 0, 0, 0);",
    "globalThis['plumbline:find'] = 3; skills.placeBlock = 4; Object.freeze(Array.prototype); Promise = null;",
    "const o = { valueOf() { bot.chat('/setblock 0 0 0 stone'); return 1; } }; await skills.placeBlock(bot, 'dirt', o, o, o);",
    "const f = () => f() + 1; try { f(); } catch (e) { log(bot, e.message); }",
    "for (let i = 0; i < 2000; i++) Promise.reject(new Error('e'.repeat(2000)));",
    "bot.chat('/fill 0 250 0 31 281 31 sand'); await skills.wait(bot, 200);",
    "setInterval(() => bot.chat('/setblock 0 0 0 stone'), 1); setTimeout(() => bot.chat('/setblock 1 0 0 stone'), 1e15);",
];

#[tokio::test]
async fn answers_that_mean_harm_are_told_what_went_wrong_and_break_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    for code in HOSTILE {
        let answer = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": code })).await;
        assert!(matches!(answer.status.as_u16(), 200 | 422), "{code}: {}", answer.text);
        assert!(answer.text.len() < 16 << 20, "{code}");
        if answer.status == 200 {
            let told = answer.json();
            let turn = &told["turns"][0];
            assert!(turn["log"].as_array().is_none_or(|log| log.len() <= 501), "{code}");
            assert!(turn["notes"].as_array().is_none_or(|notes| notes.len() <= 51), "{code}");
        }
    }
    // Such a call ends only when the system stops the process, which then tells nothing of turns.
    let endless = "const a = []; a.length = 4294967295; a.join();";
    let turns = json!([{ "events": [] }, { "action_code": endless }]);
    let grade = json!({ "task": "walls/5x1x5-raise", "profile": "mindcraft", "turns": turns });
    let faults = service.post_json("/v1/grade", &grade).await.json()["faults"].clone();
    assert!(faults[0]["detail"].as_str().unwrap().starts_with("stopped at a limit (time)"), "{faults}");
    let fine = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    let answer = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": fine })).await;
    assert_eq!(answer.json()["structure"], json!([{ "x": 0, "y": 0, "z": 0, "block": "stone" }]));
    // The same answer always gives the same events.
    let random = "for (let i = 0; i < 50; i++) await skills.placeBlock(bot, 'stone', Math.floor(Math.random() * 9), 0, Date.now() % 9);";
    let once = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": random })).await;
    let again = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": random })).await;
    assert_eq!(once.text, again.text);
}

#[tokio::test]
async fn a_submission_keeps_its_profile_and_later_turns_see_earlier_ones() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    let run = service.post_json("/v1/runs", &json!({ "agent": "a", "suite": "mineceraft" })).await.json();
    let before = service.get(&format!("/v1/runs/{}", run["id"].as_str().unwrap())).await.json();
    assert_eq!(before["profile"], Value::Null);
    let post = async |task: &str, profile: Option<&str>, turns: Value| {
        let body = json!({ "run": run["id"], "task": task, "profile": profile, "turns": turns });
        service.post_json("/v1/submissions", &body).await
    };
    let code = "await skills.placeBlock(bot, 'stone', 0, 0, 0); await skills.breakBlockAt(bot, 0, 0, 0);";
    let told = post("walls/5x1x5-raise", Some("mindcraft"), json!([{ "action_code": code }])).await;
    assert_eq!(told.status, 202, "{}", told.text);
    let submission = told.json();
    assert!(
        submission["action_code"][0]["notes"][0]
            .as_str()
            .unwrap()
            .contains("published removes only blocks of earlier turns"),
        "{submission}"
    );
    let path = format!("/v1/submissions/{}", submission["id"].as_str().unwrap());
    let graded = service.wait_for(&path, |submission| submission["state"] == "graded").await;
    assert_eq!(graded["profile"], "mindcraft");
    let report = service.get(&format!("{path}/report")).await.json();
    assert_eq!((&report["profile"], &report["turns"][0]["blocks"]), (&json!("mindcraft"), &json!(0)), "{report}");
    let log = service.get(&format!("{path}/log")).await.json();
    assert_eq!(log["profile"], "mindcraft");
    // The stored form can be posted again, and the same code under the published profile leaves the block.
    let graded =
        service.post_json("/v1/grade", &json!({ "task": "walls/5x1x5-raise", "log": log, "detail": "report" })).await;
    assert_eq!(graded.json()["report"]["turns"][0]["blocks"], 0, "{}", graded.text);
    let answer = json!({ "task": "walls/5x1x5-raise", "suite": "mineceraft@2", "answer": format!("So:\n```js\n(async (bot) => {{ {code} }})\n```"), "detail": "report" });
    assert_eq!(service.post_json("/v1/grade", &answer).await.json()["report"]["turns"][0]["blocks"], 1);
    let mut in_order = answer.clone();
    in_order["profile"] = json!("mindcraft");
    assert_eq!(service.post_json("/v1/grade", &in_order).await.json()["report"]["turns"][0]["blocks"], 0);
    let told = post("walls/5x1x5-raise", Some("minecraft"), json!([{ "events": [] }])).await;
    assert!(told.faults(422)[0].ends_with("/profile"), "{}", told.text);
    let turns = json!([{ "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);" },
                       { "action_code": ["log(bot, bot.blockAt(new Vec3(0, 0, 0)).name);", "await skills.breakBlockAt(bot, 0, 0, 0);"] }]);
    let two = service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "turns": turns })).await.json();
    assert_eq!((&two["turns"][1]["log"], &two["structure"]), (&json!(["stone"]), &json!([])), "{two}");
    // A run with submissions of both profiles says so.
    let plain = post("walls/5x1x5-courses", None, json!([{ "events": [] }])).await;
    assert_eq!(plain.status, 202, "{}", plain.text);
    let after = service.get(&format!("/v1/runs/{}", run["id"].as_str().unwrap())).await.json();
    assert_eq!(after["profile"], "mixed", "{after}");
    let profiles = service.get("/v1/profiles").await.json();
    assert_eq!(profiles["profiles"][1]["name"], "mindcraft");
}
