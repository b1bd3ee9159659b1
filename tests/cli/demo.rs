//! The main job as README tells it: the service with its demo agents, and records submitted from a file.

use std::process::Command;

use crate::support::{PROGRAM, Service, repository};
use serde_json::{Value, json};

#[tokio::test]
async fn the_demo_agents_come_onto_both_boards_once() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let has_all = |board: &Value| board["rows"].as_array().unwrap().len() == 3;
    let agents = |board: &Value| -> Vec<Value> {
        board["rows"].as_array().unwrap().iter().map(|row| row["agent"].clone()).collect()
    };
    let service = Service::start(&database, &["--demo"]);
    for suite in ["mineceraft-lite", "mineceraft"] {
        let board = service.wait_for(&format!("/v1/leaderboards/{suite}"), has_all).await;
        assert_eq!(agents(&board), ["demo: careful", "demo: hurried", "demo: confused"]);
        assert_eq!(board["rows"][0]["coverage"]["rate"], 1.0);
    }
    assert!(service.terminate());
    let again = Service::start(&database, &["--demo"]);
    let metrics = again.get("/metrics").await.text;
    assert!(metrics.contains("plumbline_submissions_not_ended 0"), "agents that are there are not posted again");
}

#[tokio::test]
async fn submit_posts_records_as_a_run_and_goes_on_with_one() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let file = folder.path().join("few.jsonl");
    let records = std::fs::read_to_string(repository("tests/conformance/run.jsonl")).unwrap();
    let few: Vec<&str> = records.lines().take(20).collect();
    std::fs::write(&file, few.join("\n")).unwrap();
    let posting = |more: &[&str]| {
        Command::new(PROGRAM).arg("submit").arg(&file).args(["--server", &service.url]).args(more).output().unwrap()
    };
    let submit = |more: &[&str]| {
        let output = posting(more);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let lite = Command::new(PROGRAM)
        .arg("submit")
        .arg(&file)
        .args(["--agent", "lab", "--suite", "mineceraft-lite", "--server", &service.url])
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&lite.stderr);
    assert!(told.contains("19 of 20 problems are not in mineceraft-lite; --only-suite leaves them out"), "{told}");
    let run = submit(&["--agent", "lab"]);
    assert_eq!((&run["state"], &run["graded"]), (&json!("finished"), &json!(20)));
    let id = run["id"].as_str().unwrap();
    assert_eq!(submit(&["--agent", "lab", "--run", id]), run);
    assert_eq!(submit(&["--run", id]), run);
    // What cannot be continued is told once, before anything is posted.
    for (more, why) in [
        (&["--run", id, "--agent", "other"][..], "is of the agent \"lab\", and --agent names \"other\""),
        (&["--run", id, "--suite", "mineceraft@2", "--only-suite"], "is a run of mineceraft@1"),
        (&["--run", "nosuch"], "--run nosuch"),
        (&[], "--agent"),
        (&["--agent", "..", "--dry-run"], "--agent: expected a name other than . and .."),
    ] {
        let output = posting(more);
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && told.contains(why), "{more:?}: {told}");
        assert!(told.matches("fault").count() < 3, "{told}");
    }
    // Records of other prompts, such as those that a pipeline numbered anew, are no answers to the tasks of the numbers.
    let mut renumbered: Value = serde_json::from_str(few[3]).unwrap();
    renumbered["prompt"] = json!("Build something else.");
    std::fs::write(&file, [few[0], &renumbered.to_string()].join("\n")).unwrap();
    let output = posting(&["--agent", "lab"]);
    let told = String::from_utf8_lossy(&output.stderr);
    let number = &renumbered["run_idx"];
    let why = format!(
        "1 of 2 problems were asked otherwise than in mineceraft@1 (run_idx {number}); there, task {number} is"
    );
    assert!(!output.status.success() && told.contains(&why), "{told}");
    assert!(told.contains("`plumbline-client mindcraft`"), "{told}");
    assert_eq!(submit(&["--agent", "lab", "--any-prompt"])["graded"], 2);
    // What has no prompt cannot be compared, which is told.
    // These records were written without prompts.
    renumbered["prompt"] = Value::Null;
    std::fs::write(&file, [few[0], &renumbered.to_string()].join("\n")).unwrap();
    let output = posting(&["--agent", "lab", "--dry-run"]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && told.contains("2 of 2 problems have no prompt"), "{told}");
}
