//! Action code: the published pipeline's events, code that means harm, and submissions that bring code.

use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::{PROGRAM, Service, repository};
use futures_util::StreamExt as _;
use futures_util::future::join_all;
use reqwest::StatusCode;
use serde_json::{Value, json};

#[test]
fn files_replay_to_the_published_events() {
    let folder = repository("tests/conformance");
    let expected: Value =
        serde_json::from_slice(&std::fs::read(folder.join("actions_expected.json")).unwrap()).unwrap();
    let files = expected.as_object().unwrap();
    assert_eq!(files.len(), 25);
    for (name, wanted) in files {
        let output = Command::new(PROGRAM).arg("replay").arg(folder.join("actions").join(name)).output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        if wanted["expect"] == "timeout" {
            assert!(!output.status.success() && told.contains("stopped: more than"), "{name}: {told}");
            continue;
        }
        // A script that is no JavaScript did nothing, and a shell must see that.
        let is_readable = !told.contains("SyntaxError");
        assert_eq!(output.status.success(), is_readable, "{name}: {told}");
        let text = String::from_utf8(output.stdout).unwrap();
        let events: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(events, *wanted["events"].as_array().unwrap(), "{name}");
    }
}

async fn replay(service: &Service, code: &str) -> crate::support::Answer {
    service.post_json("/v1/replay", &json!({ "action_code": code })).await
}

async fn replay_under(service: &Service, profile: &str, code: &str) -> crate::support::Answer {
    service.post_json("/v1/replay", &json!({ "profile": profile, "action_code": code })).await
}

fn service() -> (tempfile::TempDir, Service) {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    (folder, service)
}

#[tokio::test]
async fn a_script_keeps_what_it_did_and_is_told_what_went_wrong() {
    let (_folder, service) = service();
    let place = "skills.placeBlock(bot, 'stone', ";
    let told =
        replay(&service, &format!("(async (bot) => {{\n  {place} 0, 0, 0);\n  {place} 0.5, 0, 0);\n  nothing();\n}})"))
            .await
            .json();
    assert_eq!(told["events"], json!([{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }]));
    assert_eq!(told["dropped"], json!([{ "reason": "a coordinate is not an integer", "count": 1 }]));
    assert_eq!(told["notes"], json!([]), "{told}");
    assert_eq!([&told["error"]["line"], &told["error"]["column"]], [&json!(4), &json!(3)], "{told}");
    assert!(told["error"]["message"].as_str().unwrap().starts_with("ReferenceError"), "{told}");
    // Timers in virtual time: an hour passes at once, and in its order; what nobody awaits is reported.
    let late = format!(
        "export default async (bot) => {{ setTimeout(() => {place} 2, 0, 0), 3600000); setTimeout(() => {place} 1, 0, 0), 10);
           Promise.reject(new Error('nobody listens')); await skills.wait(bot, 20); {place} 3, 0, 0); }}"
    );
    let told = replay(&service, &late).await.json();
    let order: Vec<&Value> = told["events"].as_array().unwrap().iter().map(|event| &event["x"]).collect();
    assert_eq!(order, [1, 3, 2]);
    assert!(told["error"]["message"].as_str().unwrap().contains("nobody listens"), "{told}");
    // The same numbers each time, and no clock.
    let random =
        format!("for (let i = 0; i < 9; i++) {place} Math.floor(Math.random() * 1000), 0, new Date(0).getHours())");
    let (one, other) = (replay(&service, &random).await.json(), replay(&service, &random).await.json());
    assert_eq!((&one["events"], one["events"][0]["z"].as_i64()), (&other["events"], Some(0)));
    replay(&service, &"x".repeat(600_000)).await.faults(422);
    service.post("/v1/replay", "application/json", "{\"action_code\": 3}").await.faults(422);
}

#[tokio::test]
async fn a_submission_may_bring_code() {
    let (_folder, service) = service();
    let wall = "(async (bot) => { for (let y = 0; y < 5; y++) for (let i = 0; i < 5; i++) \
                await skills.placeBlock(bot, 'stone', y % 2 ? 4 - i : i, y, 0); oops(); })";
    let body = json!({ "task": "walls/5x1x5-raise", "suite": "mineceraft@2", "turns": [{ "action_code": wall }] });
    let accepted = service.post_json("/v1/submissions", &body).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
    let told = accepted.json();
    assert_eq!(told["action_code"][0]["events"], 25, "{told}");
    assert!(told["action_code"][0]["error"]["message"].as_str().unwrap().contains("oops"), "{told}");
    let path = format!("/v1/submissions/{}", told["id"].as_str().unwrap());
    let graded = service.wait_for(&path, |submission| submission["state"] == "graded").await;
    assert_eq!([&graded["overall"], &graded["action_code"]], [&json!(true), &told["action_code"]]);
    // The same as events is the same log.
    let events = replay(&service, wall).await.json()["events"].clone();
    let validated = service
        .post_json(
            "/v1/validate",
            &json!({ "task": "walls/5x1x5-raise", "suite": "mineceraft@2", "turns": [{ "events": events }] }),
        )
        .await;
    assert_eq!(validated.json()["submissions"][0]["log_hash"], graded["log_hash"]);
    // What reaches a limit is refused, with its place; both kinds in one turn too; grading at once says the same.
    let endless = json!({ "task": 113, "suite": "mineceraft@2", "turns": [{ "action_code": "while (true) {}" }] });
    let refused = service.post_json("/v1/submissions", &endless).await;
    assert_eq!(refused.faults(422), ["null /turns/0/action_code"]);
    assert!(refused.text.contains("stopped at a limit (time)"), "{}", refused.text);
    let nulls = json!({ "task": 113, "run": null, "suite": null, "log": null,
                        "turns": [{ "action_code": null, "palette": null, "rows": null, "events": [] }] });
    assert_eq!(service.post_json("/v1/validate", &nulls).await.status, StatusCode::OK);
    let both = json!({ "task": 113, "suite": "mineceraft@2", "turns": [{ "action_code": "", "events": [] }] });
    assert_eq!(service.post_json("/v1/submissions", &both).await.faults(422), ["null /turns/0"]);
    assert_eq!(service.post_json("/v1/grade", &endless).await.faults(422), ["null /turns/0/action_code"]);
}

/// What a model would have written around a script.
fn fenced(code: &str) -> String {
    format!(
        "<think>Perhaps ```js\nskills.placeBlock(bot, 'dirt', 9, 9, 9)\n```</think>\nI use a loop [0..4]:\n\n```javascript\n{code}\n```\nDone!"
    )
}

/// Every script of the published pipeline, as it is, through every door that takes one, and each says the same of it.
#[tokio::test]
async fn every_published_script_goes_through_every_door() {
    let (_folder, service) = service();
    let folder = repository("tests/conformance");
    let expected: Value =
        serde_json::from_slice(&std::fs::read(folder.join("actions_expected.json")).unwrap()).unwrap();
    let doors = expected.as_object().unwrap().iter().filter(|(_, wanted)| wanted["expect"] != "timeout");
    let checks = doors.map(|(name, wanted)| {
        let code = std::fs::read_to_string(folder.join("actions").join(name)).unwrap();
        let (service, events) = (&service, wanted["events"].as_array().unwrap().len());
        async move {
            let hash_of = |answer: &crate::support::Answer, pointer: &str| {
                assert!(answer.status.is_success(), "{name}: {}", answer.text);
                answer.json().pointer(pointer).and_then(Value::as_str).unwrap_or_else(|| panic!("{name}: {}", answer.text)).to_owned()
            };
            let plain = json!({ "task": 113, "suite": "mineceraft@2", "turns": [{ "action_code": code }] });
            let validated = service.post_json("/v1/validate", &plain).await;
            let hash = hash_of(&validated, "/submissions/0/log_hash");
            assert_eq!(validated.json()["submissions"][0]["events"], events, "{name}");
            for body in [
                plain.clone(),
                json!({ "task": 113, "suite": "mineceraft@2", "turns": [{ "action_code": fenced(&code) }] }),
                json!({ "task": 113, "suite": "mineceraft@2", "answer": fenced(&code) }),
                json!({ "task": 113, "suite": "mineceraft@2", "answer": json!({ "turns": [{ "action_code": code }] }).to_string() }),
            ] {
                let graded = service.post_json("/v1/grade", &body).await;
                assert_eq!(hash_of(&graded, "/log_hash"), hash, "{name}: {body}");
                assert_eq!(graded.json()["action_code"][0]["events"], events, "{name}");
                let batch = service.post("/v1/grade:batch", "application/x-ndjson", body.to_string()).await;
                assert_eq!(hash_of(&batch, "/result/log_hash"), hash, "{name}: {body}");
            }
            for kind in ["application/json", "application/x-ndjson"] {
                let accepted = service.post("/v1/submissions", kind, plain.to_string()).await;
                let place = if kind.ends_with("x-ndjson") { "/submissions/0/id" } else { "/id" };
                let stored = service.get(&format!("/v1/submissions/{}", hash_of(&accepted, place))).await;
                assert_eq!(hash_of(&stored, "/log_hash"), hash, "{name}");
            }
            let error = |answer: &Value| answer["action_code"][0]["error"].is_null();
            let reward = service.post_json("/v1/grade", &json!({ "task": 113, "suite": "mineceraft@2", "answer": fenced(&code), "reward": "shaped" })).await.json();
            let said = json!({ "task": "walls/5x1x5-raise", "suite": "mineceraft@2", "reward_scheme": "shaped", "response": { "output": [
                { "type": "message", "role": "assistant", "content": [{ "type": "output_text", "text": fenced(&code) }] }] } });
            let verified = service.post_json("/verify", &said).await.json();
            let is_readable = name != "18_syntax_error.js";
            assert_eq!(verified["reward"], reward["reward"], "{name}: {verified}");
            assert_eq!(verified.get("failure_reason").is_none(), is_readable, "{name}: {verified}");
            let label = json!({ "task": 113, "suite": "mineceraft@2", "reward": "shaped" });
            let asked = json!({ "query": [format!("Build! {}", fenced(&code))], "prompts": ["Build! "], "labels": [label] });
            let rewarded = service.post_json("/get_reward", &asked).await.json();
            assert_eq!((&rewarded["rewards"][0], &rewarded["extra_logs"]["readable"][0]), (&reward["reward"], &json!(f64::from(is_readable))), "{name}");
            let fails = ["12_throws_midway.js", "13_unknown_skill.js", "18_syntax_error.js"].contains(&name.as_str());
            assert!(!fails || !error(&reward), "{name}: its error is told");
        }
    });
    futures_util::stream::iter(checks).buffer_unordered(4).collect::<()>().await;
}

#[tokio::test]
async fn scripts_that_record_nothing_are_told_why() {
    let (_folder, service) = service();
    let place = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    for (code, events, note) in [
        (format!("async function build(bot) {{\n\t{place}\n}}"), 0, "defines build and recorded nothing"),
        (format!("const tower = async (bot) => {{ {place} }};\nlet x = 1"), 0, "defines tower and recorded nothing"),
        (format!("({{ helper() {{ return this.x }}, x: 2, async default(bot) {{ if (this.helper() === 2) {{ {place} }} }} }})"), 1, ""),
        (format!("module.exports = {{ default: async function (bot) {{ {place} }} }};"), 1, ""),
        ("(async (bot) => { const p = Vec3(1, 2, 3).offset(0, 1, 0); await skills.placeBlock(bot, 'stone', p.x, p.y, p.z); })".to_owned(), 1, ""),
        ("(async () => {})".to_owned(), 0, "ended without placing or removing"),
        ("const a = 1".to_owned(), 0, "neither its value nor module.exports is a function"),
        (format!("(async (bot) => {{ const end = Date.now() + 50; while (Date.now() < end) {{}}\n if (new Date() instanceof Date && new Date(0).toISOString() === '1970-01-01T00:00:00.000Z') {{ {place} }} }})"), 1, ""),
    ] {
        let told = replay(&service, &code).await.json();
        assert_eq!(told["events"].as_array().map(Vec::len), Some(events), "{code}: {told}");
        let notes = told["notes"].as_array().unwrap();
        assert!(if note.is_empty() { notes.is_empty() } else { notes[0].as_str().unwrap().contains(note) }, "{code}: {told}");
    }
    // The command says it too, and a script that is no JavaScript ends with 1.
    let folder = tempfile::tempdir().unwrap();
    let run = |code: &str| {
        let file = folder.path().join("a.js");
        std::fs::write(&file, code).unwrap();
        let done = Command::new(PROGRAM).arg("replay").arg(&file).output().unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, told) = run("function build() {}");
    assert!(code == Some(0) && told.contains("defines build"), "{told}");
    let (code, told) = run("(async (bot) => {\n  for (;; {\n})");
    assert!(code == Some(1) && told.contains("a.js: line 3: "), "{told}");
}

/// Code that means harm, by what it tries.
const HOSTILE: [(&str, &str); 26] = [
    ("loop", "while (true) {}"),
    ("caught loop", "while (true) { try { while (true) {} } catch (e) {} }"),
    ("getter", "const o = { get a() { while (true) {} } }; o.a"),
    ("then", "Promise.resolve({ get then() { while (true) {} } })"),
    ("promise chain", "const f = () => Promise.resolve().then(f); f()"),
    ("promise forks", "const f = () => { Promise.resolve().then(f); Promise.resolve().then(f) }; f()"),
    ("timers", "const f = () => { setTimeout(f, 0); setTimeout(f, 0) }; f()"),
    ("interval", "setInterval(() => {}, 1)"),
    ("generator", "function* g() { while (true) yield 1 } for (const x of g()) {}"),
    ("recursion", "const f = () => f() + 1; f()"),
    ("deep brackets", "eval('['.repeat(500000))"),
    ("huge string", "let s = 'x'; while (true) s += s"),
    ("array growth", "const a = []; while (true) a.push(new Array(1000).fill(1))"),
    ("typed arrays", "const a = []; while (true) a.push(new Uint8Array(1 << 24))"),
    ("typed array sort", "new Float64Array(6e6).map(() => Math.random()).sort((a, b) => { while (true) {} })"),
    ("sparse join", "const a = []; a.length = 4294967295; a.join()"),
    ("sparse sort", "const a = []; a[4294967294] = 1; a.sort()"),
    ("array-like reverse", "Array.prototype.reverse.call({ length: 2 ** 53 - 1 })"),
    ("regular expression", "/(a+)+$/.test('a'.repeat(60) + 'b')"),
    ("normalize", "'\\u0344'.repeat(8e6).normalize('NFD').normalize('NFKC')"),
    ("replaceAll", "'a'.repeat(3e7).replaceAll('a', 'bbbbbbbb')"),
    ("locals", "eval('(function(){' + Array.from({ length: 70000 }, (_, i) => 'let v' + i + '=1').join(';') + '})()')"),
    ("events", "for (let i = 0; ; i++) skills.placeBlock(bot, 'stone', i % 1000, 0, 0)"),
    (
        "pollution",
        "Object.prototype.x = 9; Promise.prototype.then = () => {}; String.prototype.trim = () => '7'; \
                   Array.prototype[Symbol.iterator] = null; skills.placeBlock(bot, 'stone', '1', 0, 0)",
    ),
    ("import", "import('fs').then((fs) => skills.placeBlock(bot, 'stone', 666, 0, 0))"),
    (
        "host",
        "for (const name of ['process', 'require', 'fetch', 'Deno', 'std', 'os', 'WebAssembly', 'XMLHttpRequest', 'Worker']) \
              if (typeof globalThis[name] !== 'undefined') skills.placeBlock(bot, name, 666, 0, 0); \
              (function () { return this })().constructor.constructor('return 1')()",
    ),
];

/// What there is to harm only where code has a world.
const HOSTILE_WORLD: &[(&str, &str)] = &[
    (
        "queries of a large world without end",
        "for (let i = 0; i < 10; i++) bot.chat(`/fill 0 ${3 * i} 0 103 ${3 * i + 2} 103 stone`);
         while (true) world.getNearestBlocks(bot, ['stone', 'grass_block'], 128, 100000);",
    ),
    (
        "a fill of a billion cells",
        "while (true) bot.chat('/gamerule commandModificationBlockLimit 2000000000'), bot.chat('/fill -500 0 -500 500 300 500 stone');",
    ),
    ("a log without end", "while (true) log(bot, 'x'.repeat(100000));"),
    ("timers without end", "const again = () => setTimeout(again, 0); again(); again(); await skills.wait(bot, 1e12);"),
];

/// Processes of action code that belong to a process.
/// Processes for action code that a process has made, with those that they have made.
fn descendants(of: u32) -> Vec<u32> {
    let own = children(of);
    own.iter().copied().chain(own.iter().flat_map(|child| children(*child))).collect()
}

fn children(of: u32) -> Vec<u32> {
    let numbers =
        std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    numbers
        .filter(|id: &u32| {
            let command = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
            let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
            let parent = status.lines().find_map(|line| line.strip_prefix("PPid:\t"));
            String::from_utf8_lossy(&command).contains("run-action-code") && parent == Some(&of.to_string())
        })
        .collect()
}

#[tokio::test]
async fn code_that_means_harm_harms_nobody() {
    let (_folder, service) = service();
    let limits = service.get("/v1/limits").await.json();
    let deadline = Duration::from_millis(limits["action_wall_ms"].as_u64().unwrap());
    let under = |profile: &'static str| move |(name, code): &(&'static str, &'static str)| (profile, *name, *code);
    let published = HOSTILE.iter().map(under("published"));
    let mindcraft = HOSTILE.iter().chain(HOSTILE_WORLD).map(under("mindcraft"));
    let all: Vec<_> = published.chain(mindcraft).collect();
    for pair in all.chunks(2) {
        let service = &service;
        let both = pair.iter().map(|(profile, name, code)| async move {
            let begun = Instant::now();
            let answer = replay_under(service, profile, code).await;
            let took = begun.elapsed();
            assert!(took < deadline + deadline / 2, "{name} took {took:?}");
            // It did nothing, failed by itself, or was stopped; it is never a failure of ours.
            match answer.status {
                StatusCode::OK => {
                    let events = answer.json()["events"].clone();
                    let is_clean = events.as_array().unwrap().iter().all(|event| event["x"] != 666);
                    assert!(is_clean, "{name}: {events}");
                    // The skills of mindcraft are JavaScript too, and the code harms itself.
                    if *name == "pollution" && *profile == "published" {
                        assert_eq!(events, json!([{ "action": "place", "x": 1, "y": 0, "z": 0, "material": "stone" }]));
                    }
                }
                StatusCode::UNPROCESSABLE_ENTITY => {
                    // Only a crash is not at a limit.
                    assert!(answer.text.contains("stopped"), "{name}: {}", answer.text);
                }
                // Tests beside this one may leave a script too little of the processor to reach a limit.
                StatusCode::SERVICE_UNAVAILABLE => {
                    assert_eq!(answer.json()["retryable"], true, "{name}: {}", answer.text);
                }
                other => panic!("{name}: {other} {}", answer.text),
            }
        });
        let others = async {
            let begun = Instant::now();
            assert_eq!(service.get("/v1/limits").await.status, StatusCode::OK);
            assert!(begun.elapsed() < Duration::from_secs(8), "others wait");
        };
        tokio::join!(join_all(both), others);
    }
    let left = descendants(service.process_id());
    assert!(left.len() <= 2, "only those that wait for the next script: {left:?}");
    // They end with the service, also where it is killed in the middle of a script.
    let endless = tokio::spawn(
        service
            .http
            .post(format!("{}/v1/replay", service.url))
            .json(&json!({ "action_code": "while (true) { /* until the service is gone */ }" }))
            .send(),
    );
    let runs = async {
        loop {
            let running = descendants(service.process_id());
            if running.len() > children(service.process_id()).len() {
                break running;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let running = tokio::time::timeout(deadline, runs).await.expect("a script runs in a process of its own");
    service.kill();
    let _ = endless.await;
    let is_left = |id: &u32| {
        let command = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&command).contains("run-action-code")
    };
    let gone = async {
        while running.iter().any(is_left) {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::time::timeout(3 * deadline, gone).await.expect("they end with the service");
}
