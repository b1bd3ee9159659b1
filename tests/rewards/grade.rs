//! Grading within the request, over a socket: single and batch.

use crate::support::Service;
use plumbline_engine::builders::build;
use plumbline_engine::builders::saboteurs::find;
use plumbline_engine::tasks::{Suite, Task, embedded};
use plumbline_engine::voxel::BlockLog;
use reqwest::StatusCode;
use serde_json::{Value, json};

fn turns(log: &BlockLog) -> Value {
    log.compact_turns()
}

fn task<'a>(suite: &'a Suite, id: &str) -> &'a Task {
    suite.tasks.iter().find(|task| task.id == id).unwrap()
}

/// What does not depend on how long it took.
fn timeless(mut graded: Value) -> Value {
    graded.as_object_mut().unwrap().remove("timings").unwrap();
    graded
}

#[tokio::test]
async fn a_log_is_graded_at_once_with_the_numbers_of_the_queue() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let suite = embedded::latest().unwrap();
    for (id, saboteur) in
        [("walls/5x1x5-raise", "widen"), ("one-layer-roofs/c5-span", "drop-corner"), ("revisions/r1-r3", "raise")]
    {
        let log = find(saboteur).unwrap().spoil(build(task(&suite, id)).unwrap());
        let body = json!({ "task": id, "turns": turns(&log), "detail": "report", "reward": "mean" });
        let answer = service.post_json("/v1/grade", &body).await;
        assert_eq!((answer.status, &answer.headers["x-plumbline-cache"]), (StatusCode::OK, &"miss".parse().unwrap()));
        let again = service.post_json("/v1/grade", &body).await;
        assert_eq!(&again.headers["x-plumbline-cache"], "hit");
        assert_eq!(timeless(again.json()), timeless(answer.json()));
        let posted = service.post_json("/v1/submissions", &json!({ "task": id, "turns": turns(&log) })).await.json();
        let path = format!("/v1/submissions/{}", posted["id"].as_str().unwrap());
        service.wait_for(&path, |submission| submission["state"] == "graded").await;
        let queued = service.get(&format!("{path}/report")).await.json();
        let graded = answer.json();
        for part in ["overall", "criteria", "turns", "advisories", "task_hash"] {
            assert_eq!(graded["report"][part], queued[part], "{id} {part}");
        }
        let means: Vec<f64> =
            queued["criteria"].as_array().unwrap().iter().map(|c| c["mean"].as_f64().unwrap()).collect();
        assert_eq!(graded["reward"], json!(means.iter().sum::<f64>() / means.len() as f64));
    }
    let metrics = service.get("/metrics").await.text;
    assert!(metrics.contains("plumbline_grade_cache_total{outcome=\"hit\"} 3"), "{metrics}");
}

#[tokio::test]
async fn answers_without_a_cache_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--grade-cache-mib", "0"]);
    let suite = embedded::latest().unwrap();
    let log = build(task(&suite, "rooms/r2-build")).unwrap();
    let body = json!({ "task": "rooms/r2-build", "turns": turns(&log) });
    let (first, second) = (service.post_json("/v1/grade", &body).await, service.post_json("/v1/grade", &body).await);
    assert_eq!(&second.headers["x-plumbline-cache"], "miss");
    assert_eq!(timeless(first.json()), timeless(second.json()));
    assert_eq!((&first.json()["reward"], &first.json()["overall"]), (&json!(1.0), &json!(true)));
}

#[tokio::test]
async fn a_trainer_brings_its_own_task_and_weights() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let wanted = json!({ "turns": [{ "prompt": "two blocks", "checks": [
        { "fn": "material.is_block_cnt_equal_to", "args": { "expected_count": 2 } },
        { "fn": "size.is_equal", "args": { "xz": [1, 2], "y": 2 }, "criterion": "size", "asks": "its size" }] }] });
    let log = json!([{ "rows": [[0, 0, 0, 0], [1, 0, 0, 0]], "palette": ["stone"] }]);
    let grade = |reward: Value| json!({ "task": wanted, "turns": log, "reward": reward });
    for (reward, expected) in [
        (json!("strict"), 0.0),
        (json!("mean"), 0.5),
        (json!({ "weights": { "material": 3, "size": 1, "efficiency": 5 } }), 0.75),
    ] {
        let graded = service.post_json("/v1/grade", &grade(reward)).await.json();
        assert_eq!(graded["reward"], json!(expected), "{graded}");
        assert_eq!(graded["components"], json!({ "overall": 0.0, "material": 1.0, "size": 0.0 }));
    }
    let none = service.post_json("/v1/grade", &grade(json!({ "weights": { "dependency": 1 } }))).await;
    assert_eq!(none.faults(422), ["null /reward/weights"]);
    // What a task of the suite says of itself can be sent back as it is.
    let shown = service.get("/v1/tasks/walls/5x1x5-raise").await.json();
    let wall = build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap();
    let graded = service.post_json("/v1/grade", &json!({ "task": shown, "turns": turns(&wall) })).await.json();
    assert_eq!(graded["reward"], json!(1.0), "{graded}");
    // Its blocks are read as the suite reads them: a door is one object, in two cells.
    assert_eq!(shown["reading"], "game");
    let door =
        json!([{ "palette": ["oak_door[half=lower]", "oak_door[half=upper]"], "rows": [[0, 0, 0, 0], [0, 1, 0, 1]] }]);
    let one = json!([{ "prompt": "a door", "checks": [
        { "fn": "material.count_is_within", "args": { "of": "oak_door", "min": 1, "max": 1 } }] }]);
    let mut asked = json!({ "task": { "reading": "game", "turns": one }, "turns": door, "reward": "mean" });
    assert_eq!(service.post_json("/v1/grade", &asked).await.json()["reward"], 1.0);
    asked["task"]["reading"] = json!("as_listed");
    assert_eq!(service.post_json("/v1/grade", &asked).await.json()["reward"], 0.0);
    asked["task"]["reading"] = json!("gmae");
    assert_eq!(service.post_json("/v1/grade", &asked).await.faults(422), ["null /task/reading"]);
    // So can a sibling.
    let siblings = service.get("/v1/siblings").await;
    let sibling: Value = serde_json::from_str(siblings.text.lines().next().unwrap()).unwrap();
    let asked = json!({ "task": sibling["task"], "turns": [{ "events": [] }] });
    assert_eq!(service.post_json("/v1/grade", &asked).await.status, StatusCode::OK);
}

#[tokio::test]
async fn all_faults_of_a_request_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let bad = json!({ "task": { "turns": [{ "checks": [{ "fn": "shape.none" }] }] }, "turns": [{ "events": [{ "action": "fly" }] }],
                      "reward": { "weights": { "beauty": 1, "size": -1, "shape": 1e308, "material": 1e-320 } }, "detail": "all", "deadline_ms": 0, "extra": 1 });
    let mut faults = service.post_json("/v1/grade", &bad).await.faults(422);
    faults.sort();
    for place in [
        "/deadline_ms",
        "/detail",
        "/extra",
        "/reward/weights/beauty",
        "/reward/weights/material",
        "/reward/weights/shape",
        "/reward/weights/size",
        "/task/turns/0/checks/0/fn",
    ] {
        assert!(faults.contains(&format!("null {place}")), "{place}: {faults:#?}");
    }
    let missing = service.post_json("/v1/grade", &json!({})).await;
    assert_eq!(missing.faults(422), ["null /task", "null /turns"]);
    let unknown =
        service.post_json("/v1/grade", &json!({ "task": "walls/none", "suite": "mineceraft@1", "turns": [] })).await;
    assert_eq!(unknown.faults(422), ["null /task"]);
    assert_eq!(service.post("/v1/grade", "application/json", "{").await.status, StatusCode::BAD_REQUEST);
    let lines = service.post("/v1/grade", "application/x-ndjson", "{}").await;
    assert!(lines.status == StatusCode::UNSUPPORTED_MEDIA_TYPE && lines.text.contains("grade:batch"), "{}", lines.text);
}

#[tokio::test]
async fn a_task_that_a_request_brings_is_read_strictly() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let mut task = service.get("/v1/tasks/walls/5x1x5-raise").await.json();
    task["nonsense"] = json!(1);
    task["id"] = json!(7);
    task["turns"][0]["promtp"] = json!("x");
    task["turns"][0]["prompt"] = json!(["two blocks"]);
    task["turns"][0]["checks"][0]["arg"] = json!({});
    task["turns"][0]["checks"][1]["args"] = json!([5, 1]);
    let told = service.post_json("/v1/grade", &json!({ "task": task, "turns": [{ "events": [] }] })).await.json();
    let fault = |pointer: &str, detail: &str| json!({ "pointer": pointer, "detail": detail });
    let expected = json!([
        fault("/task/nonsense", "unknown field"),
        fault("/task/id", "expected a string"),
        fault("/task/turns/0/promtp", "unknown field; did you mean prompt?"),
        fault("/task/turns/0/prompt", "expected a string"),
        fault("/task/turns/0/checks/0/arg", "unknown field; did you mean args?"),
        fault("/task/turns/0/checks/1/args", "expected an object with the arguments by their names"),
    ]);
    assert_eq!(told["faults"], expected, "{told:#}");
}

/// A stress simulation that cannot end in time is no score but a problem that says so.
#[tokio::test]
async fn a_deadline_that_passes_is_no_reward() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let rows: Vec<Value> = (0..20_000).map(|i| json!([i % 20, i / 400, i / 20 % 20, 0])).collect();
    let body = json!({ "task": "one-layer-roofs/c5-span", "turns": [{ "palette": ["stone"], "rows": rows }], "deadline_ms": 200 });
    let begun = std::time::Instant::now();
    let late = service.post_json("/v1/grade", &body).await;
    assert_eq!(late.status, StatusCode::GATEWAY_TIMEOUT, "{}", late.text);
    assert!(begun.elapsed().as_secs() < 30, "it ends soon after the deadline");
    let problem = late.json();
    assert_eq!((problem.get("reward"), &problem["retryable"]), (Some(&Value::Null), &json!(true)));
    assert!(late.headers.contains_key("retry-after"));
    // Code of a model that does not end is no score either before its own limit is reached.
    for work in [json!({ "answer": "while (true) {}" }), json!({ "turns": [{ "action_code": "while (true) {}" }] })] {
        let mut body = json!({ "task": "walls/5x1x5-raise", "deadline_ms": 100 });
        body.as_object_mut().unwrap().extend(work.as_object().unwrap().clone());
        let late = service.post_json("/v1/grade", &body).await;
        assert_eq!((late.status, late.json().get("reward")), (StatusCode::GATEWAY_TIMEOUT, Some(&Value::Null)));
        assert!(late.text.contains("action code"), "{}", late.text);
    }
}

/// Also where no handler is reached, a refusal that is not the sender's fault says that it is no reward.
#[tokio::test]
async fn too_many_requests_are_no_reward() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--rate-per-address", "1"]);
    let body = json!({ "task": "walls/5x1x5-raise", "turns": [{ "events": [] }] });
    let refused = async |path: &str| loop {
        let answer = service.post_json(path, &body).await;
        if answer.status == StatusCode::TOO_MANY_REQUESTS {
            let members: serde_json::Map<String, Value> = serde_json::from_str(&answer.text).unwrap();
            assert_eq!(members["retryable"], true, "{}", answer.text);
            break members.get("reward").cloned();
        }
    };
    for door in ["/v1/grade", "/v1/grade:batch", "/verify", "/get_reward"] {
        assert_eq!(refused(door).await, Some(Value::Null), "{door}");
    }
    assert_eq!(refused("/v1/submissions").await, None);
}

#[tokio::test]
async fn a_batch_answers_each_log_for_itself() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let suite = embedded::latest().unwrap();
    let mut lines: Vec<String> = suite
        .tasks
        .iter()
        .filter(|task| task.family() != "one-layer-roofs")
        .take(200)
        .map(|task| json!({ "task": task.id, "turns": turns(&build(task).unwrap()) }).to_string())
        .collect();
    lines[3] = "{".to_owned();
    lines[5] = json!({ "task": "none", "turns": [] }).to_string();
    let read = |text: &str| {
        let mut items: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        items.sort_by_key(|item| item["index"].as_u64());
        items
    };
    let answer = service.post("/v1/grade:batch", "application/x-ndjson", lines.join("\n")).await;
    assert_eq!((answer.status, answer.kind.as_str()), (StatusCode::OK, "application/x-ndjson"));
    let items = read(&answer.text);
    assert_eq!(items.len(), 200);
    for (i, item) in items.iter().enumerate() {
        let (status, reward) = match i {
            3 => (400, Value::Null),
            5 => (422, Value::Null),
            _ => (200, json!(1.0)),
        };
        assert_eq!((&item["index"], &item["status"], &item["reward"]), (&json!(i), &json!(status), &reward), "{item}");
    }
    assert_eq!(items[5]["error"]["faults"][0]["pointer"], "/task");
    let array = format!("[{}]", [lines[0].as_str(), lines[1].as_str()].join(","));
    assert_eq!(read(&service.post("/v1/grade:batch", "application/json", array).await.text).len(), 2);
    let too_many = format!("[{}0]", "0,".repeat(10_000));
    let refused = service.post("/v1/grade:batch", "application/json", too_many).await;
    assert_eq!(refused.status.as_u16(), 422, "{}", refused.text);
    for (body, status) in [("[]", 422), ("{}", 422), ("[1", 400), ("{\"a\":", 400), ("", 400)] {
        let refused = service.post("/v1/grade:batch", "application/json", body).await;
        assert_eq!(refused.status.as_u16(), status, "{body}: {}", refused.text);
    }
}

/// Neither rows nor code that ends soon wait for code that does not end.
#[tokio::test]
async fn what_is_quick_in_a_batch_passes_what_is_slow() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--grade-cache-mib", "0"]);
    let wall = turns(&build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap());
    let (code, endless) = ("placeBlock(0, 0, 0, 'stone');", "while (true) {}");
    let of_code = |code: &str| json!([{ "action_code": code }]);
    let lines: Vec<String> = (0..160)
        .map(|i| match i {
            0..6 | 50 | 100 => of_code(endless),
            10..20 | 150..160 => of_code(code),
            _ => wall.clone(),
        })
        .map(|turns| json!({ "task": "walls/5x1x5-raise", "profile": "published", "turns": turns }).to_string())
        .collect();
    let answer = service.post("/v1/grade:batch", "application/x-ndjson", lines.join("\n")).await;
    let items: Vec<Value> = answer.text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let is_endless = |item: &Value| matches!(item["index"].as_u64(), Some(0..6 | 50 | 100));
    assert_eq!(items.iter().map(is_endless).position(|is| is), Some(152), "{}", answer.text);
    for item in &items {
        let status = if is_endless(item) { 422 } else { 200 };
        assert_eq!(item["status"], status, "{item}");
    }
}

/// Code in a batch whose client does not read holds nothing that others wait for, and its results are all there later.
#[tokio::test]
async fn a_batch_that_nobody_reads_holds_up_no_code() {
    const LOGS: usize = 1_000;
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--grade-cache-mib", "0"]);
    // Six kilobytes a result, all together more than buffers take.
    let code = "for (let x = 0; x < 5; x++) placeBlock(x, 0, 0, 'stone');";
    let line =
        json!({ "task": "walls/5x1x5-raise", "turns": [{ "action_code": code }], "detail": "report" }).to_string();
    let body = vec![line; LOGS].join("\n");
    let batch = service.http.post(format!("{}/v1/grade:batch", service.url));
    let mut unread = batch.header("content-type", "application/x-ndjson").body(body).send().await.unwrap();
    assert_eq!(unread.status(), StatusCode::OK);
    for _ in 0..10 {
        let other = json!({ "profile": "mindcraft", "action_code": "placeBlock(0, 0, 0, 'stone')" });
        let replayed = service.post_json("/v1/replay", &other);
        let replayed = tokio::time::timeout(std::time::Duration::from_secs(10), replayed).await;
        let replayed = replayed.expect("code waits for a client that does not read");
        assert_eq!(replayed.status, StatusCode::OK, "{}", replayed.text);
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    let mut text = Vec::new();
    while let Some(chunk) = unread.chunk().await.unwrap() {
        text.extend_from_slice(&chunk);
    }
    let items: Vec<Value> =
        text.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    let mut indices: Vec<u64> = items.iter().map(|item| item["index"].as_u64().unwrap()).collect();
    indices.sort_unstable();
    assert!(indices.into_iter().eq(0..LOGS as u64), "each log has one result");
    assert!(items.iter().all(|item| item["status"] == 200), "{}", items[0]);
    let sent = text.len();
    assert!(sent > 4_000_000, "{sent} bytes might fit into buffers");
}

/// What earns nothing with `shaped` and what `mean` pays for it.
#[tokio::test]
async fn shaped_rewards_begin_above_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let nothing = json!([{ "events": [] }]);
    let stone = json!([{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }]);
    let wall = build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap();
    let wide = find("widen").unwrap().spoil(wall.clone());
    let reward = async |turns: &Value, scheme: &str| {
        let body = json!({ "task": "walls/5x1x5-raise", "turns": turns, "reward": scheme });
        let answer = service.post_json("/v1/grade", &body).await;
        answer.json()["reward"].as_f64().unwrap_or_else(|| panic!("{}", answer.text))
    };
    for turns in [&nothing, &stone] {
        assert_eq!(reward(turns, "shaped").await, 0.0);
    }
    assert!(reward(&stone, "mean").await > 0.2, "the reason for shaped");
    assert_eq!(reward(&turns(&wall), "shaped").await, 1.0);
    let between = reward(&turns(&wide), "shaped").await;
    assert!(0.0 < between && between < 1.0, "{between}");
    // What nothing passes cannot be shaped, and a task without checks is none.
    let vacuous = json!({ "turns": [{ "checks": [{ "fn": "physical_plausibility.is_ground_connected" }] }] });
    let asked = json!({ "task": vacuous, "turns": stone, "reward": "shaped" });
    assert_eq!(service.post_json("/v1/grade", &asked).await.faults(422), ["null /reward"]);
    let empty = json!({ "task": { "turns": [{ "checks": [] }] }, "turns": stone });
    assert_eq!(service.post_json("/v1/grade", &empty).await.faults(422), ["null /task/turns"]);
}

/// What was posted can be had back, and posted again as it is.
#[tokio::test]
async fn a_stored_log_can_be_posted_again() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let log = build(task(&embedded::latest().unwrap(), "revisions/r1-r3")).unwrap();
    let body = json!({ "task": "revisions/r1-r3", "turns": turns(&log) });
    let id = service.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned();
    let stored = service.get(&format!("/v1/submissions/{id}/log")).await.json();
    let again = json!({ "task": "revisions/r1-r3", "log": stored });
    let hash = &service.get(&format!("/v1/submissions/{id}")).await.json()["log_hash"];
    assert_eq!(service.post_json("/v1/validate", &again).await.json()["submissions"][0]["log_hash"], *hash);
    assert_eq!(service.post_json("/v1/grade", &again).await.json()["log_hash"], *hash);
    let answer = json!({ "task": "revisions/r1-r3", "answer": format!("Here: {stored}") });
    assert_eq!(service.post_json("/v1/grade", &answer).await.json()["log_hash"], *hash);
    // Clients that write all members that they know write null.
    let nulls = json!({ "task": "revisions/r1-r3", "turns": null, "log": stored, "suite": null });
    assert_eq!(service.post_json("/v1/validate", &nulls).await.status, StatusCode::OK);
    let nulls = json!({ "task": "revisions/r1-r3", "turns": turns(&log), "log": null, "answer": null, "reward": null,
                        "detail": null, "deadline_ms": null, "suite": null });
    assert_eq!(service.post_json("/v1/grade", &nulls).await.status, StatusCode::OK);
    let twice = json!({ "task": "revisions/r1-r3", "log": stored, "turns": [] });
    assert_eq!(service.post_json("/v1/validate", &twice).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    let faulty =
        json!({ "task": "revisions/r1-r3", "log": { "palette": ["stone"], "turns": [[[0, 0, 0, 7]], [[0.5, 0, 0]]] } });
    let faults = service.post_json("/v1/validate", &faulty).await.faults(422);
    assert_eq!(faults, ["null /log/turns/1/0/0", "null /log/turns/0/0/3"]);
}

#[tokio::test]
async fn validating_checks_all_that_submitting_checks_and_stores_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let run = service.begin_run("lab", "mineceraft").await;
    let good = json!({ "run": run, "task": 113, "turns": [{ "events": [] }] });
    let valid = service.post_json("/v1/validate", &good).await;
    assert_eq!((valid.status, &valid.json()["submissions"][0]["number"]), (StatusCode::OK, &json!(113)));
    let found = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!((&found["pending"], &found["graded"]), (&json!(0), &json!(0)));
    let bad = json!({ "run": "none", "task": 0, "turns": [{ "events": [{ "action": "fly" }] }], "more": 1 });
    assert_eq!(
        service.post_json("/v1/validate", &bad).await.faults(422),
        service.post_json("/v1/submissions", &bad).await.faults(422)
    );
    assert_eq!(service.post_json("/v1/submissions", &good).await.status, StatusCode::ACCEPTED);
    assert_eq!(service.post_json("/v1/validate", &good).await.json()["submissions"][0]["repeated"], json!(true));
    let other = json!({ "run": run, "task": 113, "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }] });
    assert_eq!(service.post_json("/v1/validate", &other).await.status, StatusCode::CONFLICT);
}
