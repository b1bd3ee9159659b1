//! Commands on tasks: what they print is what the API takes.

use std::process::{Command, Output};

use crate::support::{PROGRAM, Service};
use serde_json::{Value, json};

fn plumbline(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).output().unwrap()
}

fn printed(arguments: &[&str]) -> String {
    let output = plumbline(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A task found by `list` and `show` is built, posted as printed, and passes all its checks.
#[tokio::test]
async fn a_printed_build_is_posted_and_passes() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let list = printed(&["tasks", "list", "--criterion", "structural_stability", "--family", "two-layer"]);
    assert!(list.lines().count() > 1);
    let mut words = list.lines().next().unwrap().split_whitespace();
    let (number, id) = (words.next().unwrap(), words.next().unwrap());
    let shown: Value = serde_json::from_str(&printed(&["tasks", "show", number, "--json"])).unwrap();
    assert_eq!(shown["id"], id);
    assert!(printed(&["tasks", "show", id]).contains("structural_stability.stress_score {\"von_mises_stress\":"));

    let body: Value = serde_json::from_str(&printed(&["build", id])).unwrap();
    let answer = service.post_json("/v1/submissions", &body).await.json();
    let path = format!("/v1/submissions/{}", answer["id"].as_str().unwrap());
    service.wait_for(&path, |submission| submission["state"] == "graded").await;
    let report = service.get(&format!("{path}/report")).await.json();
    assert_eq!(report["overall"], true);
    let checks = report["turns"][0]["checks"].as_array().unwrap();
    let stress = checks.iter().find(|check| check["criterion"] == "structural_stability").unwrap();
    assert_eq!(stress["stress"]["sph"]["max_von_mises_pa"], stress["measured"]);
    assert_eq!(stress["stress"]["fem"]["unsupported"]["total"], 0);
    assert!(stress["stress"]["fem"]["max_von_mises_pa"].as_f64().unwrap() > 0.0);

    // The same log, event by event.
    let events: Vec<Value> = printed(&["build", id, "--format", "events"])
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .map(|mut event: Value| {
            assert_eq!(event.as_object_mut().unwrap().remove("turn"), Some(json!(1)));
            event
        })
        .collect();
    let body = json!({ "task": id, "turns": [{ "events": events }] });
    let other = service.post_json("/v1/submissions", &body).await.json();
    let log = |id: &Value| format!("/v1/submissions/{}/log", id.as_str().unwrap());
    assert_eq!(service.get(&log(&other["id"])).await.text, service.get(&log(&answer["id"])).await.text);
}

#[test]
fn a_saboteur_spoils_what_is_printed() {
    let good = printed(&["build", "113", "--format", "events"]);
    let spoiled = printed(&["build", "113", "--format", "events", "--saboteur", "wrong-material"]);
    assert_eq!(good.replace("\"stone\"", "\"sponge\""), spoiled);
    assert_ne!(good, spoiled);
}

#[test]
fn what_there_is_not_is_told() {
    for (arguments, wanted) in [
        (&["tasks", "show", "none"][..], "there is no task \"none\""),
        (&["tasks", "list", "--criterion", "beauty"], "\"beauty\" is not a criterion: material, shape"),
        (&["build", "724"], "there is no task \"724\""),
        (&["build", "1", "--saboteur", "imp"], "wrong-material  uses sponge for everything"),
    ] {
        let output = plumbline(arguments);
        assert!(!output.status.success());
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(told.contains(wanted), "{told}");
    }
}
