//! Grading over the bodies that trainers send: NeMo Gym's and OpenRLHF's.

use crate::support::Service;
use crate::support::database::pool;
use plumbline::store::db::query;
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
    // What was answered can be verified again as it is, whatever names a dataset has beside it.
    let mut again = verified.clone();
    again["failure_reason"] = json!("of an earlier response");
    for name in ["mask", "tags", "site", "schema", "data_source", "reward_model", "rewards", "tasks"] {
        again[name] = json!("x");
        again["verifier_metadata"][name] = json!("x");
    }
    let again = service.post_json("/verify", &again).await;
    let again = again.json();
    assert_eq!((&again["reward"], again.get("failure_reason")), (&json!(1.0), None), "{again}");
    // A scheme under another name is never strict in silence.
    let partly = json!({ "turns": turns(&find("widen").unwrap().spoil(wall.clone())) }).to_string();
    let named = |name: &str| json!({ "task": 113, "response": { "output_text": partly }, name: "shaped" });
    for name in ["reward", "scheme", "reward_scheme"] {
        let reward = service.post_json("/verify", &named(name)).await.json()["reward"].as_f64().unwrap();
        assert!(reward > 0.0 && reward < 1.0, "{name}: {reward}");
    }
    assert_eq!(service.post_json("/verify", &named("rewards")).await.faults(422), ["null /rewards"]);
    let weights = json!({ "weights": { "material": 1 } });
    let misnamed =
        json!({ "task": 113, "response": { "output_text": partly }, "verifier_metadata": { "rewards": weights } });
    assert_eq!(service.post_json("/verify", &misnamed).await.faults(422), ["null /verifier_metadata/rewards"]);
    // A trainer that is wired wrongly is told, and no model blamed.
    for (response, place) in [
        (Value::Null, "null /response"),
        (json!("text"), "null /response"),
        (json!({ "output": null }), "null /response/output"),
        (json!({ "output": "text" }), "null /response/output"),
    ] {
        let body = json!({ "task": 113, "response": response });
        assert_eq!(service.post_json("/verify", &body).await.faults(422), [place], "{body}");
    }
    let text = json!({ "turns": turns(&wall) }).to_string();
    for response in [
        json!({ "output_text": text }),
        json!({ "choices": [{ "message": { "role": "assistant", "content": text } }] }),
        json!({ "output": [{ "role": "assistant", "content": text }] }),
    ] {
        let body = json!({ "task": 113, "response": response });
        assert_eq!(service.post_json("/verify", &body).await.json()["reward"], json!(1.0), "{body}");
    }
    // Code that is no JavaScript is told, and earns nothing.
    let broken = service.post_json("/verify", &said("```js\nawait skills.placeBlock(bot \"x\")\n```")).await.json();
    assert_eq!((&broken["reward"], &broken["reward_size"]), (&json!(0.0), &json!(0.0)), "{broken}");
    assert!(broken["failure_reason"].as_str().unwrap().contains("not JavaScript"), "{broken}");
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
    for wrong in ["schme", "rewrd", "profle"] {
        let mut misspelt = said("[]");
        misspelt["verifier_metadata"][wrong] = json!("mean");
        let told = service.post_json("/verify", &misspelt).await.faults(422);
        assert_eq!(told, [format!("null /verifier_metadata/{wrong}")]);
    }
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
    assert_eq!((&half["reward"], half.get("failure_reason")), (&json!(0.0), None), "{half}");
    // Who stops early has built what stands, as in an episode.
    let mean = json!({ "task": id, "answer": first.to_string(), "reward": "mean" });
    let half = service.post_json("/v1/grade", &mean).await.json();
    let reward = half["reward"].as_f64().unwrap();
    assert!(reward > 0.0 && reward < 1.0, "{half}");
    assert_eq!(half["answer"]["empty_turns"], json!([{ "text": 2, "why": "the model stopped before this turn" }]));
    let empty = json!({ "task": id, "turns": [first, { "events": [] }], "reward": "mean" });
    assert_eq!(service.post_json("/v1/grade", &empty).await.json()["reward"], json!(reward));
    let texts = json!({ "task": id, "answer": [first.to_string(), format!("<think>{first}</think>{second}")] });
    let graded = service.post_json("/v1/grade", &texts).await.json();
    assert_eq!((&graded["reward"], &graded["answer"]["found"][1]["text"]), (&json!(1.0), &json!(2)), "{graded}");
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
    assert_eq!(refused.faults(422), ["null /labels/0", "null /labels/1/task"]);
    assert_eq!(refused.json()["detail"], "2 faults");
    // Several endpoints of an older trainer get nothing to do, and must not fail.
    let none = json!({ "query": [], "prompts": [], "labels": [] });
    assert_eq!(service.post_json("/get_reward", &none).await.json()["rewards"], json!([]));
    assert_eq!(
        service.post_json("/get_reward", &json!({ "query": ["a"], "labels": [] })).await.faults(422),
        ["null /labels"]
    );
}

/// A task that cannot be read any more is a failure of the service, and nobody's reward of 0.
#[tokio::test]
async fn openrlhf_gets_no_reward_from_damaged_data() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let wall = build(task(&embedded::latest().unwrap(), "walls/5x1x5-raise")).unwrap();
    let body = json!({ "query": [turns(&wall).to_string(), "no"], "labels": ["walls/5x1x5-raise", { "task": 1, "suite": "torn" }] });
    let wrong = service.post_json("/get_reward", &body).await.json();
    assert_eq!(wrong["rewards"], json!([1.0, 0.0]), "no suite of this name: {wrong}");
    for scheme in [json!("shaped"), json!({ "weights": { "material": 1 } }), json!({ "material": 1 })] {
        let misnamed = json!({ "query": ["no"], "labels": [{ "task": "walls/5x1x5-raise", "rewards": scheme }] });
        assert_eq!(service.post_json("/get_reward", &misnamed).await.faults(422), ["null /labels/0/rewards"]);
    }
    for (label, place) in [
        (json!({ "task": 113, "reward": "mean", "scheme": "strict" }), "null /labels/0/scheme"),
        (json!({ "task": 113, "schem": "mean" }), "null /labels/0/schem"),
        (json!({ "task": 113, "weights": { "material": 1 } }), "null /labels/0/weights"),
    ] {
        let misnamed = json!({ "query": ["no"], "labels": [label] });
        assert_eq!(service.post_json("/get_reward", &misnamed).await.faults(422), [place]);
    }
    // Rows of a joined data set have nulls.
    for label in [
        json!({ "task": 113, "reward": null, "scheme": "mean" }),
        json!({ "task": 113, "reward": "mean", "scheme": null }),
    ] {
        let query = json!({ "query": ["{\"events\": []}"], "labels": [label] });
        let given = service.post_json("/get_reward", &query).await.json();
        assert!(given["rewards"][0].as_f64().unwrap() > 0.0, "{given}");
    }
    let twice =
        json!({ "task": 113, "response": { "output_text": "no" }, "reward_scheme": "mean", "scheme": "strict" });
    assert_eq!(service.post_json("/verify", &twice).await.faults(422), ["null /scheme"]);
    // A label is as small as text as it is as JSON.
    let many = format!("{{\"task\":1,\"x\":[{}0]}}", "{\"\":0},".repeat(90_000));
    let told = service.post_json("/get_reward", &json!({ "query": ["no"], "labels": [many] })).await;
    assert!(told.faults(422) == ["null /labels/0"] && told.text.contains("more than"), "{}", told.text);

    let pool = pool(&database).await;
    for statement in [
        "INSERT INTO suites (id, name, version, task_count, content_hash, created_at_ms) VALUES ('torn@1', 'torn', 1, 1, 'x', 0)",
        "INSERT INTO tasks (hash, id, family, body) VALUES ('y', 'walls/torn', 'walls', '{\"id\":')",
        "INSERT INTO suite_tasks (suite_id, number, task_hash) VALUES ('torn@1', 1, 'y')",
    ] {
        query(statement).execute(&pool).await.unwrap();
    }
    let refused = service.post_json("/get_reward", &body).await;
    let problem = refused.json();
    assert_eq!(refused.status, StatusCode::INTERNAL_SERVER_ERROR, "{problem}");
    assert_eq!((&problem["type"], &problem["retryable"]), (&json!("urn:plumbline:problem:damaged"), &json!(false)));
    assert!(problem.get("rewards").is_none(), "{problem}");
}

/// Each row of a data set asks for a reward that the service gives.
#[tokio::test]
async fn a_shaped_data_set_has_no_row_that_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let rows = |scheme: &'static str| {
        let path = format!("/v1/tasks?format=openrlhf&suite=mineceraft-lite@1&scheme={scheme}");
        let service = &service;
        async move {
            let text = service.get(&path).await.text;
            let rows: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            rows
        }
    };
    let (shaped, strict) = (rows("shaped").await, rows("strict").await);
    assert!(shaped.len() < strict.len() && shaped.len() > 15, "{} of {}", shaped.len(), strict.len());
    let task = |row: &Value| {
        let label: Value = serde_json::from_str(row["label"].as_str().unwrap()).unwrap();
        label["task"].as_str().unwrap().to_owned()
    };
    let kept: Vec<String> = shaped.iter().map(task).collect();
    for task in strict.iter().map(task) {
        let body =
            json!({ "task": task, "suite": "mineceraft-lite@1", "reward": "shaped", "answer": "{\"events\": []}" });
        let graded = service.post_json("/v1/grade", &body).await;
        let expected = if kept.contains(&task) { 200 } else { 422 };
        assert_eq!(graded.status, expected, "{task}: {}", graded.text);
    }
}

#[tokio::test]
async fn all_rollouts_of_a_step_are_rewarded_although_each_comes_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let answer =
        "```js\nfor (let x = 0; x < 5; x++) {\n  await skills.placeBlock(bot, 'stone', x, 0, 0);\n}\n```<|im_end|>";
    let sample = json!({ "query": [answer], "prompts": [""], "labels": [{ "task": "walls/5x1x5-raise", "profile": "mindcraft",
                         "reward": "mean" }] });
    let row = json!({ "task": "walls/5x1x5-raise", "profile": "mindcraft", "reward_scheme": "mean",
                      "response": { "output_text": answer } });
    // Labels for other frameworks name the scheme otherwise.
    for naming in [
        json!({ "task": "walls/5x1x5-raise", "profile": "mindcraft", "scheme": "mean" }),
        json!({ "scheme": 3, "task": "walls/5x1x5-raise", "profile": "mindcraft", "verifier_metadata": { "scheme": "mean" } }),
        json!({ "verifier_metadata": { "task": "walls/5x1x5-raise", "profile": "mindcraft", "reward": "mean" }, "reward": 0.5 }),
    ] {
        let mut sent = json!({ "response": { "output_text": answer } });
        sent.as_object_mut().unwrap().extend(naming.as_object().unwrap().clone());
        let found = service.post_json("/verify", &sent).await.json();
        assert_eq!(found["reward"], service.post_json("/verify", &row).await.json()["reward"], "{naming}");
    }
    let requests = (0..150).flat_map(|_| [("/get_reward", &sample), ("/verify", &row)]);
    let answers = futures_util::future::join_all(requests.map(|(path, body)| service.post_json(path, body))).await;
    let refused: Vec<&str> =
        answers.iter().filter(|answer| answer.status != 200).map(|one| one.text.as_str()).collect();
    assert!(refused.is_empty(), "{} of {}: {}", refused.len(), answers.len(), refused[0]);
    assert!(answers.iter().all(|answer| answer.json()["reward"].as_f64().unwrap_or(1.0) > 0.0));
}
