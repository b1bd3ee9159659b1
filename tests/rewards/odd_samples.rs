//! Samples that trainers send although something is odd about them: texts cut amid a character, no text at all,
//! generations that failed, and members that contradict each other.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::support::{Answer, Service};

const TASK: &str = "walls/5x1x5-raise";
const WALL: &str = "```js\nfor (let y = 0; y < 5; y++) {\n\tfor (let x = 0; x < 5; x++) {\n\t\tawait \
                    skills.placeBlock(bot, 'stone', x, y, 3);\n\t}\n}\n```";

fn start() -> (tempfile::TempDir, Service) {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    (folder, service)
}

/// Posts JSON with half of a surrogate pair in place of the mark: no library for Rust writes one.
async fn post_with_half(service: &Service, path: &str, body: &Value) -> Answer {
    service.post(path, "application/json", body.to_string().replace("HALF", "\\ud83d")).await
}

#[tokio::test]
async fn a_text_that_was_cut_amid_a_character_is_graded_at_every_door() {
    let (_folder, service) = start();
    let cut = format!("{WALL}\nDone HALF");
    let rewarded =
        post_with_half(&service, "/get_reward", &json!({ "query": [WALL, cut], "labels": [TASK, TASK] })).await;
    assert_eq!(rewarded.status, StatusCode::OK, "{}", rewarded.text);
    assert_eq!(rewarded.json()["rewards"], json!([1.0, 1.0]), "{}", rewarded.text);
    let row = json!({ "task": TASK, "response": { "output_text": cut } });
    let verified = post_with_half(&service, "/verify", &row).await.json();
    // The request is repeated as it was read.
    assert_eq!(
        (&verified["reward"], &verified["response"]["output_text"]),
        (&json!(1.0), &json!(cut.replace("HALF", "\u{fffd}")))
    );
    let one = json!({ "task": TASK, "answer": cut });
    assert_eq!(post_with_half(&service, "/v1/grade", &one).await.json()["reward"], 1.0);
    let line = one.to_string().replace("HALF", "\\ud83d");
    let lines = service.post("/v1/grade:batch", "application/x-ndjson", line).await;
    assert!(lines.text.contains("\"reward\":1.0"), "{}", lines.text);
    let code = json!({ "task": TASK, "turns": [{ "action_code": "bot.chat('HALF');" }] });
    let accepted = post_with_half(&service, "/v1/submissions", &code).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
}

#[tokio::test]
async fn a_sample_without_a_text_spoils_no_other() {
    let (_folder, service) = start();
    let rewarded =
        service.post_json("/get_reward", &json!({ "query": [WALL, null], "labels": [TASK, TASK] })).await.json();
    assert_eq!(rewarded["rewards"], json!([1.0, 0.0]), "{rewarded}");
    assert_eq!(rewarded["problems"][0]["index"], 1, "{rewarded}");
    // A label that is JSON as text may hold half a character of its own.
    let label = json!({ "task": TASK, "note": "HALF" }).to_string();
    let sent = json!({ "query": [WALL], "labels": [label.replace("HALF", "\\ud83d")] });
    let told = service.post_json("/get_reward", &sent).await.json();
    assert_eq!(told["rewards"], json!([1.0]), "{told}");
    // A label that names a task of several turns shows.
    let several = json!({ "query": [WALL], "labels": ["growing-houses/annex"] });
    let told = service.post_json("/get_reward", &several).await.json()["problems"][0]["detail"].to_string();
    assert!(told.contains("turns are empty: the model stopped before this turn"), "{told}");
}

#[tokio::test]
async fn a_generation_that_failed_is_left_out() {
    let (_folder, service) = start();
    let response = |status: &str| {
        json!({ "task": TASK, "responses_create_params": { "input": "Raise a wall." },
                "response": { "status": status, "error": { "code": "server_error", "message": "x" }, "output": [] } })
    };
    for (status, is_left_out) in [("failed", true), ("cancelled", true), ("in_progress", true), ("incomplete", false)] {
        let told = service.post_json("/verify", &response(status)).await.json();
        assert_eq!((&told["reward"], &told["mask_sample"]), (&json!(0.0), &json!(is_left_out)), "{told}");
        let mut without_output = response(status);
        without_output["response"]["output"] = Value::Null;
        let answer = service.post_json("/verify", &without_output).await;
        assert_eq!(answer.status == StatusCode::OK, is_left_out, "{}", answer.text);
        let why = told["failure_reason"].as_str().unwrap();
        assert_eq!(why.contains(&format!("its status is {status} (server_error)")), is_left_out, "{why}");
    }
}

#[tokio::test]
async fn members_that_contradict_each_other_are_named_where_they_stand() {
    let (_folder, service) = start();
    let sent = |top: Value, below: Value| {
        let mut sent = json!({ "task": TASK, "response": { "output_text": WALL }, "verifier_metadata": below });
        sent.as_object_mut().unwrap().extend(top.as_object().unwrap().clone());
        sent
    };
    for (top, below, pointer) in [
        (json!({}), json!({ "task": "walls/10x2x7-bulkhead" }), "/verifier_metadata/task"),
        (json!({ "profile": "published" }), json!({ "profile": "mindcraft" }), "/verifier_metadata/profile"),
        (json!({ "reward_scheme": "strict" }), json!({ "scheme": "mean" }), "/verifier_metadata/scheme"),
        (json!({}), json!({ "profile": "Mindcraft" }), "/verifier_metadata/profile"),
        (json!({}), json!({ "suite": "minecraft" }), "/verifier_metadata/suite"),
        (json!({ "task": null }), json!({ "task": "walls/none" }), "/verifier_metadata/task"),
        (json!({}), json!({ "reward_scheme": "best" }), "/verifier_metadata/reward_scheme"),
    ] {
        let refused = service.post_json("/verify", &sent(top, below.clone())).await;
        assert_eq!(refused.faults(422), [format!("null {pointer}")], "{below}");
    }
    let both = sent(json!({ "task": 113 }), json!({ "task": TASK }));
    assert_eq!(service.post_json("/verify", &both).await.status, StatusCode::OK, "a number and an id of one task");
    // What is said twice in the same way, and texts of the data set that name no scheme, are fine.
    let below = json!({ "task": TASK, "profile": "mindcraft", "scheme": "https", "reward": "binary" });
    let graded = service.post_json("/verify", &sent(json!({ "reward_scheme": "strict" }), below)).await;
    assert_eq!(graded.json()["reward"], 1.0, "{}", graded.text);
}
