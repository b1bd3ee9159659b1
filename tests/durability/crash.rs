//! SIGKILL loses no acknowledged submission and leaves nothing stuck.

use crate::support::Service;
use serde_json::{Value, json};

const SUBMISSIONS: usize = 1_000;

/// A cabin of planks for task 532 and a block beside it, elsewhere each time, so that no two logs are the same.
fn submission(i: usize) -> String {
    let mut rows: Vec<Value> = Vec::new();
    for cell in 0..64 {
        let (x, y, z) = (cell / 16, cell / 4 % 4, cell % 4);
        if [x, y, z].iter().any(|c| [0, 3].contains(c)) {
            rows.push(json!([x, y, z, 0]));
        }
    }
    rows.push(json!([10, 0, i, 0]));
    json!({ "task": 532, "turns": [{ "palette": ["oak_planks"], "rows": rows }] }).to_string()
}

#[tokio::test]
async fn killed_while_grading_and_started_again_it_ends_with_every_report() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let lease = ["--lease-seconds", "1"];
    let service = Service::start(&database, &lease);
    let mut ids: Vec<String> = Vec::new();
    let lines: Vec<String> = (0..SUBMISSIONS).map(submission).collect();
    for batch in lines.chunks(250) {
        let answer = service.post("/v1/submissions", "application/x-ndjson", batch.join("\n")).await;
        assert_eq!(answer.status, 202, "{}", answer.text);
        let accepted = answer.json();
        ids.extend(accepted["submissions"].as_array().unwrap().iter().map(|s| s["id"].as_str().unwrap().to_owned()));
    }
    let left = service.not_ended().await;
    service.kill();
    assert!(left != Some(0), "all was graded before the kill; the test shows nothing");

    // Killed once more, at once after the start, which is in the middle of claiming.
    for pause_ms in [40] {
        let service = Service::start(&database, &lease);
        tokio::time::sleep(std::time::Duration::from_millis(pause_ms)).await;
        service.kill();
    }
    let service = Service::start(&database, &lease);
    service.settle("killed").await;
    for id in &ids {
        let submission = service.get(&format!("/v1/submissions/{id}")).await.json();
        assert_eq!(submission["state"], "graded", "{submission}");
        let report = service.get(&format!("/v1/submissions/{id}/report")).await.json();
        assert_eq!(report["turns"][0]["blocks"], 57, "{report}");
    }
    assert_eq!(ids.len(), SUBMISSIONS);
}
