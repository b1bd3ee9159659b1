//! Cancelling: what waits or is being graded ends, and its task may be answered again; places in the queue are told.

use crate::support::Service;
use reqwest::StatusCode;
use serde_json::{Value, json};

/// A log that takes seconds to grade.
fn slow(run: &str, task: &str) -> Value {
    let rows: Vec<Value> = (0..20_000).map(|i| json!([i % 20, i / 400, i / 20 % 20, 0])).collect();
    json!({ "run": run, "task": task, "turns": [{ "palette": ["stone"], "rows": rows }] })
}

#[tokio::test]
async fn what_is_cancelled_ends_and_leaves_its_task_free() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "1"]);
    let run = service.begin_run("a", "mineceraft-lite").await;
    let roof = service.get("/v1/tasks?suite=mineceraft-lite&type=columns").await.json();
    let [first, second] = [0, 1].map(|i| roof["tasks"][i]["id"].as_str().unwrap().to_owned());
    let post =
        async |body: Value| service.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned();
    let graded = post(slow(&run, &first)).await;
    let path = |id: &str| format!("/v1/submissions/{id}");
    service.wait_for(&path(&graded), |submission| submission["state"] == "grading").await;
    let waiting = post(slow(&run, &second)).await;
    let third = post(json!({ "run": run, "task": 15, "turns": [{ "events": [] }] })).await;
    let place = service.get(&path(&waiting)).await.json()["queued_before"].clone();
    assert_eq!(place, 1, "the one being graded ends first");
    // What is quick waits for none of them, although there is one worker for what is not.
    service.wait_for(&path(&third), |submission| submission["state"] == "graded").await;
    assert_eq!(service.get(&path(&graded)).await.json()["state"], "grading");
    // One waits, one is being graded.
    for id in [&waiting, &graded] {
        let cancelled = service.post_json(&format!("{}/cancel", path(id)), &json!({})).await;
        assert_eq!((cancelled.status, &cancelled.json()["state"]), (StatusCode::OK, &json!("cancelled")));
        let again = service.post_json(&format!("{}/cancel", path(id)), &json!({})).await;
        assert_eq!(again.status, StatusCode::OK, "cancelling twice is cancelling");
    }
    let ended = service.wait_for(&path(&third), |submission| submission["state"] == "graded").await;
    assert_eq!(ended.get("queued_before"), None);
    let refused = service.post_json(&format!("{}/cancel", path(&third)), &json!({})).await;
    assert_eq!(refused.status, StatusCode::CONFLICT, "{}", refused.text);
    let counted = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!((&counted["pending"], &counted["graded"], &counted["grader_errors"]), (&json!(0), &json!(1), &json!(0)));
    // Answered again, otherwise.
    let quick = json!({ "run": run, "task": second, "turns": [{ "events": [] }] });
    assert_eq!(service.post_json("/v1/submissions", &quick).await.status, StatusCode::ACCEPTED);
    service.post_json(&format!("/v1/runs/{run}/finish"), &json!({})).await;
    let finished = service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    assert_eq!((&finished["graded"], &finished["summary"]["problem_level"]["overall"]["of"]), (&json!(2), &json!(25)));
    assert_eq!(
        service.get(&path(&graded)).await.json()["state"],
        "cancelled",
        "a report that came late changed nothing"
    );
    let late = json!({ "run": run, "task": first, "turns": [{ "events": [] }] });
    assert_eq!(service.post_json("/v1/submissions", &late).await.status, StatusCode::CONFLICT, "the run has finished");
    assert_eq!(service.post_json("/v1/submissions/none/cancel", &json!({})).await.status, StatusCode::NOT_FOUND);
}
