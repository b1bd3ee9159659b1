//! Quota, events and rate limits, over HTTP as a lab sees them.

use std::path::Path;
use std::process::Command;

use crate::support::{Answer, PROGRAM, Service};
use reqwest::StatusCode;
use serde_json::{Value, json};

fn command(database: &Path, arguments: &[&str]) -> String {
    let output =
        Command::new(PROGRAM).args(arguments).args(crate::support::database::named(database)).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

async fn as_owner(service: &Service, key: &str, method: &str, path: &str, body: Option<Value>) -> Answer {
    let url = format!("{}{path}", service.url);
    let request = service.http.request(method.parse().unwrap(), url).bearer_auth(key);
    service.send(if let Some(body) = body { request.json(&body) } else { request }).await
}

fn block(x: i32) -> Value {
    json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] })
}

#[tokio::test]
async fn what_is_granted_is_reserved_charged_and_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let key = command(&database, &["keys", "create", "--name", "lab"]);
    let shown = command(&database, &["quota", "grant", "--name", "lab", "--submissions", "3", "--reason", "a trial"]);
    assert!(shown.starts_with("lab: granted 3, left 3; reserved 0, charged 0"), "{shown}");
    let mut ids = Vec::new();
    for x in 0..2 {
        let accepted = as_owner(&service, &key, "POST", "/v1/submissions", Some(block(x))).await;
        assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
        ids.push(accepted.json()["id"].as_str().unwrap().to_owned());
    }
    for id in &ids {
        service.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] == "graded").await;
    }
    let quota = as_owner(&service, &key, "GET", "/v1/quota?limit=2", None).await.json();
    assert_eq!([&quota["granted"], &quota["charged"], &quota["left"]], [&json!(3), &json!(2), &json!(1)], "{quota}");
    let next = quota["next_before"].as_i64().unwrap();
    let rest = as_owner(&service, &key, "GET", &format!("/v1/quota?before={next}"), None).await.json();
    let kinds = |page: &Value| -> Vec<String> {
        page["entries"].as_array().unwrap().iter().map(|e| e["kind"].as_str().unwrap().to_owned()).collect()
    };
    let mut all = [kinds(&quota), kinds(&rest)].concat();
    assert_eq!(all.pop().unwrap(), "grant", "the oldest comes last");
    all.sort();
    assert_eq!(all, ["charge", "charge", "reserve", "reserve"]);

    // Two at once for the one that is left: neither is accepted, and nothing is held back.
    let lines = [block(5).to_string(), block(6).to_string()].join("\n");
    let request = service.http.post(format!("{}/v1/submissions", service.url)).bearer_auth(&key);
    let refused = service.send(request.header("content-type", "application/x-ndjson").body(lines)).await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN, "{}", refused.text);
    assert_eq!(refused.json()["type"], "urn:plumbline:problem:quota-used-up");
    let validated = as_owner(&service, &key, "POST", "/v1/validate", Some(block(7))).await;
    assert_eq!(validated.status, StatusCode::OK, "{}", validated.text);
    let quota = as_owner(&service, &key, "GET", "/v1/quota", None).await.json();
    assert_eq!([&quota["reserved"], &quota["left"]], [&json!(0), &json!(1)], "{quota}");

    // Another's is nobody's business, but for the operator.
    let other = command(&database, &["keys", "create", "--name", "other"]);
    let operator = command(&database, &["keys", "create", "--name", "operator", "--scopes", "admin"]);
    let path = "/v1/quota?owner=lab";
    assert_eq!(as_owner(&service, &other, "GET", path, None).await.status, StatusCode::FORBIDDEN);
    assert_eq!(as_owner(&service, &operator, "GET", path, None).await.json()["charged"], 2);
    assert_eq!(service.get("/v1/quota").await.status, StatusCode::UNAUTHORIZED);
}

/// Reads a stream until it holds so many events; gives id, name and data of each.
async fn follow(service: &Service, path: &str, last: Option<&str>, events: usize) -> Vec<(String, String, Value)> {
    let mut request = service.http.get(format!("{}{path}", service.url));
    if let Some(last) = last {
        request = request.header("last-event-id", last);
    }
    let mut response = request.send().await.unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    assert_eq!(response.headers()["x-accel-buffering"], "no", "nginx would hold events back");
    let mut text = String::new();
    while text.matches("\n\n").count() < events {
        let chunk = tokio::time::timeout(std::time::Duration::from_secs(30), response.chunk()).await;
        text += std::str::from_utf8(&chunk.expect("the stream is silent").unwrap().unwrap()).unwrap();
    }
    let field = |event: &str, name: &str| {
        event.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_else(|| panic!("{event}")).trim().to_owned()
    };
    text.split_terminator("\n\n")
        .map(|event| {
            (field(event, "id:"), field(event, "event:"), serde_json::from_str(&field(event, "data:")).unwrap())
        })
        .collect()
}

#[tokio::test]
async fn who_follows_misses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let run = service.begin_run("a", "mineceraft").await;
    let path = format!("/v1/events?run={run}");
    let all = async { follow(&service, &path, None, 4).await };
    let working = async {
        for task in 1..4 {
            let log = json!({ "palette": ["stone"], "rows": [[task, 0, 0, 0]] });
            let body = json!({ "run": run, "task": task, "turns": [log] });
            assert_eq!(service.post_json("/v1/submissions", &body).await.status, StatusCode::ACCEPTED);
        }
        service.post_json("/v1/submissions", &block(9)).await;
        let finished = service.post(&format!("/v1/runs/{run}/finish"), "application/json", "").await;
        assert_eq!(finished.status, StatusCode::OK);
    };
    let (seen, ()) = tokio::join!(all, working);
    let names: Vec<&str> = seen.iter().map(|(_, name, _)| name.as_str()).collect();
    assert_eq!(names, ["submission", "submission", "submission", "run"]);
    assert!(seen.iter().all(|(_, _, data)| data["run"] == json!(run)), "{seen:?}");
    assert_eq!([&seen[0].2["state"], &seen[3].2["state"]], [&json!("graded"), &json!("finished")]);
    assert!(seen[0].2["overall"].is_boolean());
    // Coming back after the second, it goes on with the third.
    let rest = follow(&service, &path, Some(&seen[1].0), 2).await;
    assert_eq!(rest, seen[2..]);
    let one = seen[0].2["submission"].as_str().unwrap();
    assert_eq!(follow(&service, &format!("/v1/events?submission={one}"), None, 1).await, seen[..1]);
    assert_eq!(service.get("/v1/events?run=nobody").await.status, StatusCode::NOT_FOUND);
    assert_eq!(service.get("/v1/events?run=a&submission=b").await.status, StatusCode::BAD_REQUEST);
    // A stream that is open does not keep the service from stopping.
    let mut open = service.http.get(format!("{}/v1/events", service.url)).send().await.unwrap();
    let begun = std::time::Instant::now();
    assert!(service.terminate());
    assert!(begun.elapsed() < std::time::Duration::from_secs(9));
    assert!(open.chunk().await.is_ok_and(|rest| rest.is_none()));
}

#[tokio::test]
async fn who_sends_too_many_is_told_so_and_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let rates = ["--rate-per-key", "20", "--rate-per-address", "10", "--behind-proxy"];
    let service = Service::start_as_told(&database, &rates);
    let key = command(&database, &["keys", "create", "--name", "lab"]);
    let from = |address: &str| {
        service.http.get(format!("{}/v1/limits", service.url)).header("x-forwarded-for", format!("9.9.9.9, {address}"))
    };
    let first = service.send(from("1.2.3.4")).await;
    assert_eq!(first.json()["requests_per_second_per_address"], 10);
    assert_eq!(first.headers["ratelimit-limit"], "10");
    assert_eq!(first.headers["ratelimit-remaining"], "9");
    let mut last = first;
    for _ in 0..200 {
        last = service.send(from("1.2.3.4")).await;
        if last.status == StatusCode::TOO_MANY_REQUESTS {
            break;
        }
    }
    assert_eq!((last.status, last.kind.as_str()), (StatusCode::TOO_MANY_REQUESTS, "application/problem+json"));
    assert_eq!([&last.headers["ratelimit-remaining"], &last.headers["retry-after"]], ["0", "1"]);
    assert_eq!(service.send(from("1.2.3.5")).await.status, StatusCode::OK);
    // A key has a count of its own; one that is unknown has none, and counts for its address.
    let keyed = service.send(from("1.2.3.4").bearer_auth(&key)).await;
    assert_eq!((keyed.status, &keyed.headers["ratelimit-limit"]), (StatusCode::OK, &"20".parse().unwrap()));
    let unknown = service.send(from("1.2.3.6").bearer_auth("plk_000000000000_0")).await;
    assert_eq!(unknown.headers["ratelimit-limit"], "10");
}
