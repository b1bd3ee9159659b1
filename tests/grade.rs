//! Grading within the request, over a socket: single, batch, and the bodies of trainers.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod support;

use plumbline::builders::build;
use plumbline::builders::saboteurs::find;
use plumbline::tasks::{Suite, Task, embedded};
use plumbline::voxel::BlockLog;
use reqwest::StatusCode;
use serde_json::{Value, json};
use support::Service;

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
}

#[tokio::test]
async fn all_faults_of_a_request_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let bad = json!({ "task": { "turns": [{ "checks": [{ "fn": "shape.none" }] }] }, "turns": [{ "events": [{ "action": "fly" }] }],
                      "reward": { "weights": { "beauty": 1, "size": -1 } }, "detail": "all", "deadline_ms": 0, "extra": 1 });
    let mut faults = service.post_json("/v1/grade", &bad).await.faults(422);
    faults.sort();
    for place in [
        "/deadline_ms",
        "/detail",
        "/extra",
        "/reward/weights/beauty",
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
    assert!(begun.elapsed().as_secs() < 5, "it ends soon after the deadline");
    let problem = late.json();
    assert_eq!((problem.get("reward"), &problem["retryable"]), (Some(&Value::Null), &json!(true)));
    assert!(late.headers.contains_key("retry-after"));
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
    for (body, status) in [("[]", 422), ("{}", 400), ("[1", 400)] {
        let refused = service.post("/v1/grade:batch", "application/json", body).await;
        assert_eq!(refused.status.as_u16(), status, "{body}: {}", refused.text);
    }
}

#[tokio::test]
async fn nemo_gym_verifies_the_last_message() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let wall = build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap();
    let said = |text: &str| {
        json!({ "responses_create_params": { "input": "Raise a wall." }, "verifier_metadata": { "task": "walls/5x1x5-raise" },
                "response": { "id": "r", "output": [
                    { "type": "reasoning", "summary": [] },
                    { "type": "message", "role": "assistant", "content": [{ "type": "output_text", "text": text }] }] } })
    };
    let good = said(&format!("Done:\n```json\n{}\n```", json!({ "turns": turns(&wall) })));
    let verified = service.post_json("/verify", &good).await;
    assert_eq!(verified.status, StatusCode::OK, "{}", verified.text);
    let verified = verified.json();
    assert_eq!((&verified["reward"], &verified["mask_sample"]), (&json!(1.0), &json!(false)));
    assert_eq!(verified["reward_components"]["efficiency"], json!(1.0));
    assert_eq!(verified["reward_efficiency"], json!(1.0), "numbers at the top are what the framework makes means of");
    assert_eq!(verified["response"], good["response"], "the request is repeated");
    let refusal = service.post_json("/verify", &said("I cannot build.")).await.json();
    assert_eq!(
        (&refusal["reward"], &refusal["failure_reason"]),
        (&json!(0.0), &json!("there is neither a block log as JSON nor action code in the answer"))
    );
    let mut unnamed = said("[]");
    unnamed.as_object_mut().unwrap().remove("verifier_metadata");
    assert_eq!(service.post_json("/verify", &unnamed).await.faults(422), ["null /task"]);
    assert_eq!(service.post_json("/verify", &said("[]")).await.json()["reward"], json!(0.0));
    let mut misspelt = said("[]");
    misspelt["verifier_metadata"]["reward_schem"] = json!("mean");
    assert_eq!(service.post_json("/verify", &misspelt).await.faults(422), ["null /verifier_metadata/reward_schem"]);
    assert_eq!(service.post_json("/seed_session", &json!({})).await.json(), json!({}));
    // The calls of the framework's environment servers, and what they must bring back.
    let begun = json!({ "resources_session_id": "s1", "episode_id": { "rollout_id": "r", "attempt": 0 },
                        "task_id": { "taskset": "t", "task_id": "walls/5x1x5-raise" }, "task_data": {} });
    let seeded = service.post_json("/seed_session", &begun).await;
    assert_eq!(seeded.json(), json!({ "resources_session_id": "s1" }));
    assert!(seeded.headers.contains_key("set-cookie"));
    for _ in 0..2 {
        assert_eq!(service.post_json("/close_session", &begun).await.json()["resources_session_id"], "s1");
    }
    assert_eq!(service.get("/reverify_mode").await.json(), json!("stateless"));
    let nested = json!({ "episode_id": begun["episode_id"], "task_id": begun["task_id"],
                         "verification_input": { "response": good["response"] } });
    let verified = service.post_json("/ng-rollout/r-1/verify", &nested).await.json();
    assert_eq!((&verified["reward"], verified.get("verification_input")), (&json!(1.0), None), "{verified}");
    let rows = json!({ "verify_responses": [{ "_ng_task_index": 1, "reward": 1.0, "reward_material": 0.5, "mask_sample": false }] });
    let metrics = service.post_json("/aggregate_metrics", &rows).await.json();
    assert_eq!(metrics["key_metrics"], json!({ "mean/reward": 1.0, "mean/reward_material": 0.5 }));
}

/// Several messages of an assistant answer a task of several turns; what others say between does not count.
#[tokio::test]
async fn messages_are_turns() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let id = "revisions/r1-r3";
    let log = build(task(&embedded::latest().unwrap(), id)).unwrap();
    let turns = turns(&log);
    let (first, second) = (&turns[0], &turns[1]);
    let message = |role: &str, text: String| json!({ "type": "message", "role": role, "content": text });
    let said = |output: Vec<Value>| json!({ "task": id, "response": { "output": output } });
    let whole = said(vec![
        message("assistant", format!("First: {first}")),
        message("user", "{\"events\": []}".to_owned()),
        message("assistant", format!("Then:\n```json\n{second}\n```")),
    ]);
    let verified = service.post_json("/verify", &whole).await.json();
    assert_eq!((&verified["reward"], verified.get("failure_reason")), (&json!(1.0), None), "{verified}");
    let half = service.post_json("/verify", &said(vec![message("assistant", first.to_string())])).await.json();
    assert_eq!(half["failure_reason"], "1 of the 2 turns of the task are answered", "{half}");
    let texts = json!({ "task": id, "answer": [first.to_string(), format!("<think>{first}</think>{second}")] });
    let graded = service.post_json("/v1/grade", &texts).await.json();
    assert_eq!((&graded["reward"], &graded["answer"]["found"][1]["text"]), (&json!(1.0), &json!(2)), "{graded}");
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
    let twice = json!({ "task": "revisions/r1-r3", "log": stored, "turns": [] });
    assert_eq!(service.post_json("/v1/validate", &twice).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    let faulty =
        json!({ "task": "revisions/r1-r3", "log": { "palette": ["stone"], "turns": [[[0, 0, 0, 7]], [[0.5, 0, 0]]] } });
    let faults = service.post_json("/v1/validate", &faulty).await.faults(422);
    assert_eq!(faults, ["null /log/turns/1/0/0", "null /log/turns/0/0/3"]);
}

#[tokio::test]
async fn openrlhf_reads_rewards_scores_and_logs() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let wall = build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap();
    let wide = find("widen").unwrap().spoil(wall.clone());
    let prompt = "Raise a wall {5 wide}.";
    let query = |log: &BlockLog| format!("{prompt}{}", turns(log));
    let naming = json!({ "task": 113, "suite": "mineceraft@2", "reward": "mean" }).to_string();
    let body = json!({ "query": [query(&wall), query(&wide), format!("{prompt}no"), query(&wide)], "prompts": [prompt, prompt, prompt, prompt],
                       "labels": ["walls/5x1x5-raise", "113", "113", naming] });
    let rewards = service.post_json("/get_reward", &body).await;
    assert_eq!(rewards.status, StatusCode::OK, "{}", rewards.text);
    let rewards = rewards.json();
    assert_eq!(rewards["scores"], json!([1.0, 0.0, 0.0, 0.0]));
    assert_eq!(rewards["extra_logs"]["readable"], json!([1.0, 1.0, 0.0, 1.0]));
    let mean = rewards["rewards"][3].as_f64().unwrap();
    assert!(0.5 < mean && mean < 1.0 && rewards["extra_logs"]["criteria_mean"][3] == json!(mean), "{rewards}");
    // A label that is wrong is told, and spoils nobody else's reward; where all are, the request is refused.
    let wrong =
        json!({ "query": [query(&wall), "b", "c"], "labels": ["113", "tower", { "task": 113, "rewrd": "mean" }] });
    let told = service.post_json("/get_reward", &wrong).await.json();
    assert_eq!(
        (&told["rewards"], &told["extra_logs"]["mislabelled"]),
        (&json!([1.0, 0.0, 0.0]), &json!([0.0, 1.0, 1.0]))
    );
    let places: Vec<&Value> = told["problems"].as_array().unwrap().iter().map(|p| &p["faults"][0]["pointer"]).collect();
    assert_eq!(places, ["/labels/1/task", "/labels/2/rewrd"], "{told}");
    let all_wrong = json!({ "query": ["a", "b"], "labels": ["", "walls/5x1x5-rais"] });
    let refused = service.post_json("/get_reward", &all_wrong).await;
    assert_eq!(refused.faults(422)[0], "null /labels/0/task");
    // Several endpoints of an older trainer get nothing to do, and must not fail.
    let none = json!({ "query": [], "prompts": [], "labels": [] });
    assert_eq!(service.post_json("/get_reward", &none).await.json()["rewards"], json!([]));
    assert_eq!(
        service.post_json("/get_reward", &json!({ "query": ["a"], "labels": [] })).await.faults(422),
        ["null /labels"]
    );
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
