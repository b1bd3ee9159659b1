//! Grading again: computed beside what holds, looked at, applied as one switch or thrown away; old reports stay.

use std::path::Path;
use std::process::Command;

use crate::support::database::is_postgres;
use crate::support::{PROGRAM, Service};
use plumbline::store::db::{query, query_scalar};
use reqwest::StatusCode;
use serde_json::{Value, json};

fn regrade(database: &Path, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(PROGRAM)
        .arg("regrade")
        .args(arguments)
        .args(crate::support::database::named(database))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() { Ok(text(&output.stdout)) } else { Err(text(&output.stderr)) }
}

/// Has a submission's report and its run's result as checks of an earlier version might have made them: not solved.
async fn age(database: &Path, submission: &str, run: &str) {
    let pool = crate::support::database::pool(database).await;
    let scores: String = query_scalar("SELECT scores FROM reports WHERE submission_id = $1")
        .bind(submission)
        .fetch_one(&pool)
        .await
        .unwrap();
    let statement = "UPDATE reports SET overall = FALSE, checks_version = 0, scores = $2 WHERE submission_id = $1";
    let aged = query(statement).bind(submission).bind(scores.replacen("1.0", "0.0", 1));
    assert_eq!(aged.execute(&pool).await.unwrap(), 1);
    let summary: String =
        query_scalar("SELECT summary FROM results WHERE run_id = $1").bind(run).fetch_one(&pool).await.unwrap();
    let mut summary: Value = serde_json::from_str(&summary).unwrap();
    summary["problem_level"]["overall"] = json!({ "pass": 24, "of": 25, "rate": 0.96 });
    let aged = query("UPDATE results SET summary = $2 WHERE run_id = $1").bind(run).bind(summary.to_string());
    assert_eq!(aged.execute(&pool).await.unwrap(), 1);
}

#[tokio::test]
async fn a_regrade_is_looked_at_and_then_holds_or_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let run = service.finished_run("aged", 0).await;
    service.finished_run("other", 1).await;
    let page = service.get(&format!("/v1/runs/{run}/submissions?limit=1")).await.json();
    let submission = page["submissions"][0]["id"].as_str().unwrap().to_owned();
    age(&database, &submission, &run).await;
    let overall = || async {
        let board = service.get("/v1/leaderboards/mineceraft-lite?agent=aged").await.json();
        board["rows"][0]["overall"]["rate"].as_f64().unwrap()
    };
    assert_eq!(overall().await, 0.96);

    assert!(regrade(&database, &["--suite", "mineceraft-lite"]).unwrap_err().contains("--reason"));
    assert!(regrade(&database, &["--suite", "nothing", "--reason", "r"]).unwrap_err().contains("no suite"));
    let told =
        regrade(&database, &["--suite", "mineceraft-lite", "--reason", "doors count", "--actor", "ada"]).unwrap();
    assert!(told.contains("1 submission with other scores; 1 problem with another verdict"), "{told}");
    assert!(told.contains(&format!("solved  {submission}")), "{told}");
    assert!(told.contains("96.0 %") && told.contains("100.0 %"), "{told}");
    assert_eq!(overall().await, 0.96, "nothing holds before it is applied");
    let id = told.lines().find_map(|line| line.strip_prefix("plumbline regrade discard ")).unwrap();
    // The URL of a server, which may hold a password, is not repeated.
    let (id, file) = id.split_once(" --database ").unwrap_or((id, ""));
    assert_eq!(file, if is_postgres() { String::new() } else { database.display().to_string() });
    assert_eq!(regrade(&database, &["discard", id]).unwrap().trim(), "discarded");
    assert!(regrade(&database, &["apply", id]).unwrap_err().contains("discarded, not ready"));

    let told =
        regrade(&database, &["--suite", "mineceraft-lite", "--reason", "doors count", "--actor", "ada"]).unwrap();
    let id = told.lines().find_map(|line| line.strip_prefix("plumbline regrade apply ")).unwrap();
    let id = id.split(' ').next().unwrap();
    assert_eq!(regrade(&database, &["apply", id]).unwrap().trim(), "applied; 1 finished run has new results");
    tokio::time::sleep(std::time::Duration::from_millis(1_100)).await;
    assert_eq!(overall().await, 1.0, "the service that runs follows");
    let path = format!("/v1/submissions/{submission}/report");
    let (new, old) = (service.get(&path).await.json(), service.get(&format!("{path}?attempt=1")).await.json());
    assert_eq!([&new["provenance"]["attempt"], &old["provenance"]["attempt"]], [&json!(2), &json!(1)]);
    assert_eq!(service.get(&format!("{path}?attempt=9")).await.status, StatusCode::NOT_FOUND);
    let actions = service.get("/v1/leaderboards/mineceraft-lite/actions").await.json();
    assert_eq!(actions["actions"].as_array().unwrap().len(), 1);
    let action = &actions["actions"][0];
    let told = ["run", "action", "actor", "reason"].map(|name| action[name].as_str().unwrap());
    assert_eq!(told, [run.as_str(), "regrade", "ada", "doors count"]);
    assert!(regrade(&database, &["list"]).unwrap().contains("applied"));
    let again = regrade(&database, &["--suite", "mineceraft-lite", "--reason", "to be sure"]).unwrap();
    assert!(again.contains("0 submissions with other scores") && again.contains("no run on the board"), "{again}");
}
