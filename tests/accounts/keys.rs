//! Keys: reading is public, writing needs one with the right scope, runs belong to owners, and owners take turns.

use std::path::Path;
use std::process::Command;

use crate::support::{Answer, PROGRAM, Service};
use plumbline_engine::builders::build;
use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::{Value, json};

fn keys(database: &Path, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(PROGRAM)
        .arg("keys")
        .args(arguments)
        .args(crate::support::database::named(database))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    if output.status.success() { Ok(text(&output.stdout)) } else { Err(text(&output.stderr)) }
}

async fn post(service: &Service, path: &str, key: Option<&str>, body: &Value) -> Answer {
    let mut request = service.http.post(format!("{}{path}", service.url)).json(body);
    if let Some(key) = key {
        request = request.bearer_auth(key);
    }
    service.send(request).await
}

#[tokio::test]
async fn writing_needs_a_key_and_reading_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    assert_eq!(service.get("/v1/leaderboards/mineceraft").await.status, StatusCode::OK);
    let run = json!({ "agent": "a", "suite": "mineceraft" });
    let log = json!({ "task": 113, "turns": [{ "events": [] }] });
    let refused = post(&service, "/v1/runs", None, &run).await;
    assert_eq!(
        (refused.status, &refused.headers["www-authenticate"]),
        (StatusCode::UNAUTHORIZED, &"Bearer".parse().unwrap())
    );
    for path in
        ["/v1/submissions", "/v1/validate", "/v1/grade", "/v1/grade:batch", "/verify", "/get_reward", "/seed_session"]
    {
        let refused = post(&service, path, None, &log).await;
        assert_eq!(
            (refused.status, refused.kind.as_str()),
            (StatusCode::UNAUTHORIZED, "application/problem+json"),
            "{path}"
        );
    }
    let submit = keys(&database, &["create", "--name", "lab", "--scopes", "submit"]).unwrap();
    let grade = keys(&database, &["create", "--name", "lab", "--scopes", "grade", "--expires", "30"]).unwrap();
    let begun = post(&service, "/v1/runs", Some(&submit), &run).await;
    assert_eq!((begun.status, &begun.json()["owner"]), (StatusCode::CREATED, &json!("lab")));
    assert_eq!(post(&service, "/v1/runs", Some(&grade), &run).await.status, StatusCode::FORBIDDEN);
    assert_eq!(post(&service, "/v1/grade", Some(&grade), &log).await.status, StatusCode::OK);
    assert_eq!(post(&service, "/v1/grade", Some(&submit), &log).await.status, StatusCode::FORBIDDEN);
    let (id, _) = submit.strip_prefix("plk_").unwrap().split_once('_').unwrap();
    for wrong in [
        "x",
        "plk_",
        &format!("plk_{id}_wrong"),
        &format!("plk_000000000000_{}", "0".repeat(64)),
        &submit[..submit.len() - 1],
    ] {
        assert_eq!(post(&service, "/v1/runs", Some(wrong), &run).await.status, StatusCode::UNAUTHORIZED, "{wrong}");
    }
    // The file holds no secret, and neither does the list.
    let secret = submit.rsplit('_').next().unwrap();
    for ending in ["", "-wal"] {
        let bytes = std::fs::read(format!("{}{ending}", database.display())).unwrap_or_default();
        assert!(!bytes.windows(secret.len()).any(|part| part == secret.as_bytes()));
    }
    let list = keys(&database, &["list"]).unwrap();
    assert!(list.contains(id) && list.contains("live until") && !list.contains(secret), "{list}");
    // A third live key is one too many; a revoked one makes room, and works no longer.
    assert!(keys(&database, &["create", "--name", "lab"]).unwrap_err().contains("2 live keys"));
    keys(&database, &["revoke", id]).unwrap();
    keys(&database, &["create", "--name", "lab"]).unwrap();
    assert!(keys(&database, &["revoke", id]).unwrap_err().contains("no longer live"));
    tokio::time::sleep(std::time::Duration::from_millis(600)).await;
    assert_eq!(post(&service, "/v1/runs", Some(&submit), &run).await.status, StatusCode::UNAUTHORIZED);
    assert!(
        keys(&database, &["create", "--name", "x", "--scopes", "all"])
            .unwrap_err()
            .contains("\"all\" is not one of submit")
    );
}

#[tokio::test]
async fn a_run_is_its_owner_s() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let [ours, theirs, admin] = [("us", "submit"), ("them", "submit"), ("host", "admin")]
        .map(|(name, scopes)| keys(&database, &["create", "--name", name, "--scopes", scopes]).unwrap());
    let run = post(&service, "/v1/runs", Some(&ours), &json!({ "agent": "a", "suite": "mineceraft" })).await.json();
    let id = run["id"].as_str().unwrap();
    let log = json!({ "run": id, "task": 113, "turns": [{ "events": [] }] });
    let finish = format!("/v1/runs/{id}/finish");
    for (path, body) in [("/v1/submissions", &log), ("/v1/validate", &log), (finish.as_str(), &json!({}))] {
        let refused = post(&service, path, Some(&theirs), body).await;
        assert_eq!(refused.status, StatusCode::FORBIDDEN, "{path}: {}", refused.text);
    }
    assert_eq!(post(&service, "/v1/submissions", Some(&ours), &log).await.status, StatusCode::ACCEPTED);
    assert_eq!(service.get(&format!("/v1/runs/{id}")).await.status, StatusCode::OK, "reading is public");
    assert_eq!(post(&service, &finish, Some(&admin), &json!({})).await.status, StatusCode::OK);
}

/// Somebody's hundred slow jobs, and then one of somebody else's: it is graded long before the hundred.
#[tokio::test]
async fn owners_take_turns() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &["--workers", "1"]);
    let [many, one] = ["many", "one"].map(|name| keys(&database, &["create", "--name", name]).unwrap());
    let suite = embedded::latest().unwrap();
    let roof = suite.tasks.iter().find(|task| task.id == "one-layer-roofs/c5-span").unwrap();
    let log = json!({ "task": roof.id, "turns": build(roof).unwrap().compact_turns() });
    let lines = vec![log.to_string(); 100].join("\n");
    let request = service.http.post(format!("{}/v1/submissions", service.url)).bearer_auth(&many).body(lines);
    let posted = service.send(request.header("content-type", "application/x-ndjson")).await.json();
    let last = posted["submissions"][99]["id"].as_str().unwrap();
    let single = post(&service, "/v1/submissions", Some(&one), &log).await.json();
    let path = format!("/v1/submissions/{}", single["id"].as_str().unwrap());
    service.wait_for(&path, |submission| submission["state"] == "graded").await;
    assert_eq!(
        service.get(&format!("/v1/submissions/{last}")).await.json()["state"],
        "queued",
        "the hundred still wait"
    );
}

#[tokio::test]
async fn the_demo_has_a_key_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start_as_told(&folder.path().join("p.db"), &["--demo"]);
    let has_all = |board: &Value| board["rows"].as_array().unwrap().len() == 3;
    service.wait_for("/v1/leaderboards/mineceraft-lite", has_all).await;
    let refused = post(&service, "/v1/runs", None, &json!({ "agent": "a", "suite": "mineceraft" })).await;
    assert_eq!(refused.status, StatusCode::UNAUTHORIZED);
}
