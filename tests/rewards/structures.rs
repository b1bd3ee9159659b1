//! Builds as structure files: downloaded from submissions, and graded again.

use crate::support::{Answer, Service};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plumbline_engine::builders::build;
use plumbline_engine::checks::Dimension;
use plumbline_engine::tasks::{Task, embedded};
use serde_json::{Value, json};

const FORMATS: [&str; 3] = ["nbt", "schem", "litematic"];

fn checks_order(task: &Task) -> bool {
    task.checks().any(|check| check.criterion().dimension() == Dimension::Planning)
}

/// Posts the reference build of a task, and returns the path of the graded submission.
async fn graded(service: &Service, task: &Task) -> String {
    let body = json!({ "task": task.id, "turns": build(task).unwrap().compact_turns() });
    let posted = service.post_json("/v1/submissions", &body).await.json();
    let path = format!("/v1/submissions/{}", posted["id"].as_str().unwrap());
    service.wait_for(&path, |submission| submission["state"] == "graded").await;
    path
}

/// Downloads what stands after a turn, as a turn of a body.
async fn turn_of(service: &Service, path: &str, turn: usize, format: &str) -> (Value, Vec<u8>) {
    let url = format!("{}{path}/structure?turn={turn}&format={format}", service.url);
    let file = service.http.get(url).send().await.unwrap();
    assert_eq!(file.status(), 200);
    let header = |name: &str| file.headers()[name].to_str().unwrap().to_owned();
    let corner: Vec<i32> = header("x-plumbline-corner").split(',').map(|part| part.parse().unwrap()).collect();
    let name = header("content-disposition");
    let bytes = file.bytes().await.unwrap().to_vec();
    assert!(name.ends_with(&format!(".{format}\"")), "{name}");
    (json!({ "structure": STANDARD.encode(&bytes), "corner": corner }), bytes)
}

/// Returns the score of each check that is not about order.
fn scores(graded: &Value) -> Vec<Value> {
    let checks = graded["checks"].as_array().unwrap().iter();
    checks
        .filter(|check| !["efficiency", "dependency"].contains(&check["criterion"].as_str().unwrap()))
        .cloned()
        .collect()
}

#[tokio::test]
async fn a_build_is_graded_from_its_files_as_from_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    let suite = embedded::latest().unwrap();
    let mut families = std::collections::BTreeSet::new();
    for task in suite.tasks.iter().filter(|task| families.insert(task.family().to_owned())) {
        let turns = build(task).unwrap().compact_turns();
        let from_log = service.post_json("/v1/grade", &json!({ "task": task.id, "turns": turns })).await.json();
        if scores(&from_log).is_empty() {
            continue;
        }
        let path = graded(&service, task).await;
        for format in FORMATS {
            let mut turns = Vec::new();
            for turn in 1..=task.turns.len() {
                turns.push(turn_of(&service, &path, turn, format).await.0);
            }
            let from_files = service.post_json("/v1/grade", &json!({ "task": task.id, "turns": turns })).await.json();
            assert_eq!(scores(&from_files), scores(&from_log), "{} as {format}", task.id);
            let left_out = from_files["not_measured"].as_array().map_or(0, Vec::len);
            let all = from_log["checks"].as_array().unwrap().len();
            assert_eq!(left_out, all - scores(&from_log).len(), "{}", task.id);
        }
    }
    assert!(families.len() > 20);
}

#[tokio::test]
async fn a_file_is_accepted_where_order_does_not_count_and_a_faulty_one_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    let suite = embedded::latest().unwrap();
    let of_one_turn =
        |order: bool| suite.tasks.iter().find(|task| task.turns.len() == 1 && checks_order(task) == order).unwrap();
    let task = of_one_turn(false);
    let path = graded(&service, task).await;
    let (turn, file) = turn_of(&service, &path, 1, "litematic").await;

    // The bytes alone, as a player has them.
    let grade = async |query: &str, file: &[u8]| -> Answer {
        service.post(&format!("/v1/grade:structure?{query}"), "application/octet-stream", file.to_vec()).await
    };
    let answer = grade(&format!("task={}&reward=mean&detail=report", task.id), &file).await;
    assert_eq!(answer.status, 200, "{}", answer.text);
    assert_eq!(answer.json()["overall"], true, "{}", answer.text);

    // A model that could send a file would choose that its order is not checked.
    let text = json!({ "turns": [turn] }).to_string();
    let of_model = service.post_json("/v1/grade", &json!({ "task": task.id, "answer": text })).await.json();
    assert_eq!(of_model["reward"], 0.0, "{of_model}");
    assert!(of_model["answer"]["why"].as_str().unwrap().contains("no structure files"), "{of_model}");

    // As a submission, where the order does not count.
    let body = |task: &Task, turn: &Value| json!({ "task": task.id, "turns": [turn] });
    let accepted = service.post_json("/v1/submissions", &body(task, &turn)).await;
    assert_eq!(accepted.status, 202, "{}", accepted.text);
    let of_files = format!("/v1/submissions/{}", accepted.json()["id"].as_str().unwrap());
    let graded = service.wait_for(&of_files, |submission| submission["state"] == "graded").await;
    assert_eq!(graded["overall"], true, "{graded}");
    let refused = service.post_json("/v1/submissions", &body(of_one_turn(true), &turn)).await;
    assert!(refused.text.contains("does not tell in which order"), "{}", refused.text);

    // Wrapped base64 is fine; these are not.
    let text = turn["structure"].as_str().unwrap();
    let wrapped = text.as_bytes().chunks(76).map(|line| str::from_utf8(line).unwrap()).collect::<Vec<_>>().join("\n");
    let answer = service.post_json("/v1/grade", &body(task, &json!({ "structure": wrapped }))).await;
    assert_eq!(answer.status, 200, "{}", answer.text);
    for (turn, pointer, reason) in [
        (json!({ "structure": "no file!" }), "/turns/0/structure", "not base64"),
        (json!({ "structure": "" }), "/turns/0/structure", "the file is empty"),
        (json!({ "structure": 7 }), "/turns/0/structure", "expected a string"),
        (json!({ "structure": STANDARD.encode("PK\x03\x04") }), "/turns/0/structure", "a ZIP archive"),
        (json!({ "structure": text, "corner": [0, 9999, 0] }), "/turns/0/corner", "\"corner\" moves the build"),
        (json!({ "structure": text, "corner": [0, 1] }), "/turns/0/corner", "expected 3 integers"),
        (json!({ "structure": text, "events": [] }), "/turns/0", "give either events"),
        (json!({ "corner": [0, 0, 0], "events": [] }), "/turns/0/corner", "only a structure has a corner"),
    ] {
        for path in ["/v1/grade", "/v1/submissions"] {
            let answer = service.post_json(path, &body(task, &turn)).await;
            assert_eq!(answer.status, 422, "{}", answer.text);
            let fault = &answer.json()["faults"][0];
            assert_eq!(fault["pointer"], pointer, "{}", answer.text);
            assert!(fault["detail"].as_str().unwrap().contains(reason), "{}", answer.text);
        }
    }
    for (query, status, reason) in [
        (format!("task={}&corner=1,2", task.id), 400, "three integers"),
        ("task=walls/none".to_owned(), 422, "\"parameter\":\"task\""),
        (format!("task={}", suite.tasks.iter().find(|task| task.turns.len() > 1).unwrap().id), 422, "several turns"),
        (format!("task={}&reward=best", task.id), 422, "expected"),
        (format!("task={}&colour=red", task.id), 400, "colour"),
    ] {
        let answer = grade(&query, &file).await;
        assert_eq!(answer.status, status, "{}", answer.text);
        assert!(answer.text.contains(reason), "{}", answer.text);
    }
    assert_eq!(grade(&format!("task={}", task.number), &file).await.json()["task"], task.id);
    assert_eq!(grade(&format!("task={}", task.id), b"").await.faults(422), ["null "]);
    let line = body(task, &turn).to_string();
    let many = service.post("/v1/submissions", "application/x-ndjson", [line.as_str()].repeat(65).join("\n")).await;
    assert_eq!(many.faults(422), ["65 /turns/0/structure"]);
    for (query, status) in [("turn=2", 404), ("turn=0", 404), ("format=obj", 400), ("turn=x", 400)] {
        assert_eq!(service.get(&format!("{path}/structure?{query}")).await.status, status, "{query}");
    }
}
