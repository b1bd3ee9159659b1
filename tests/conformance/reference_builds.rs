//! The builders' own logs through the service: every task of the latest version is solved, and of the published one all
//! but true arches.

use crate::support::Service;
use plumbline_engine::builders::build;
use plumbline_engine::tasks::Suite;
use plumbline_engine::tasks::embedded;
use serde_json::{Value, json};

/// Posts a good build for each task, as one run, and gives the summary of the finished run.
async fn run_of_builders(service: &Service, suite: &Suite) -> Value {
    let run = service.begin_run("builders", &suite.id()).await;
    let mut lines = String::new();
    for task in &suite.tasks {
        let turns = build(task).unwrap().compact_turns();
        lines.push_str(&json!({ "run": run, "task": task.id, "turns": turns }).to_string());
        lines.push('\n');
    }
    let posted = service.post("/v1/submissions", "application/x-ndjson", lines).await;
    assert_eq!(posted.status, 202, "{}", posted.text);
    let finished = service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    finished["summary"].clone()
}

#[tokio::test]
async fn every_task_of_the_latest_version_is_solved() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let summary = run_of_builders(&service, &embedded::latest().unwrap()).await;
    assert_eq!(summary["problem_level"]["overall"]["pass"], 723, "{summary}");
    assert_eq!(summary["check_level"]["accuracy"]["mean"], 1.0);
    assert_eq!((&summary["graded"]["stress"]["n"], &summary["graded"]["stress"]["mean"]), (&json!(21), &json!(1.0)));
    assert_eq!(summary["graded"]["efficiency"]["n"], 112);
    assert!(summary["graded"]["efficiency"]["mean"].as_f64().unwrap() >= 0.95);
}

/// The 45 arch problems, 643 to 687: 9 under stress and 36 bridges.
#[tokio::test]
async fn of_the_published_version_all_but_true_arches_are_solved() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let summary = run_of_builders(&service, &embedded::suite(1).unwrap()).await;
    let passed: Vec<u64> =
        summary["passed_runs"]["overall"].as_array().unwrap().iter().filter_map(Value::as_u64).collect();
    let expected: Vec<u64> = (1..=723).filter(|number| !(643..=687).contains(number)).collect();
    assert_eq!(passed, expected);
}
