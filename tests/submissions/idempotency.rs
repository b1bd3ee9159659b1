//! Idempotency-Key: what is sent twice is carried out once, also over a restart.

use crate::support::{Answer, Service};
use reqwest::StatusCode;
use serde_json::{Value, json};

async fn post(service: &Service, path: &str, key: &str, body: &Value) -> Answer {
    let request = service.http.post(format!("{}{path}", service.url)).header("idempotency-key", key).json(body);
    service.send(request).await
}

fn is_replayed(answer: &Answer) -> bool {
    answer.headers.contains_key("idempotency-replayed")
}

#[tokio::test]
async fn the_same_request_has_one_effect_and_one_answer() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let run = json!({ "agent": "a", "suite": "mineceraft" });
    let first = post(&service, "/v1/runs", "run-1", &run).await;
    assert_eq!((first.status, is_replayed(&first)), (StatusCode::CREATED, false));
    let log = json!({ "task": 113, "turns": [{ "events": [] }] });
    let submitted = post(&service, "/v1/submissions", "log-1", &log).await;
    assert_eq!(submitted.status, StatusCode::ACCEPTED);
    // SIGKILL: what was answered is remembered.
    service.kill();
    let service = Service::start(&database, &[]);
    for (path, key, body, before) in
        [("/v1/runs", "run-1", &run, &first), ("/v1/submissions", "log-1", &log, &submitted)]
    {
        let again = post(&service, path, key, body).await;
        assert!(is_replayed(&again));
        assert_eq!((again.status, &again.text), (before.status, &before.text), "{path}");
        assert_eq!(again.headers["location"], before.headers["location"]);
        let new = post(&service, path, &format!("new-{key}"), body).await;
        assert!(!is_replayed(&new) && new.text != before.text, "another key is another request");
        let mut changed = body.clone();
        changed["suite"] = json!("mineceraft@1");
        let refused = post(&service, path, key, &changed).await;
        assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY);
        assert!(refused.json()["type"].as_str().unwrap().ends_with("idempotency-key-reused"), "{}", refused.text);
        // The key belongs to its operation.
        let (other_path, other) = if path == "/v1/runs" { ("/v1/submissions", &log) } else { ("/v1/runs", &run) };
        assert_eq!(post(&service, other_path, key, other).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    }
    let long = post(&service, "/v1/runs", &"k".repeat(201), &run).await;
    assert_eq!(long.status, StatusCode::BAD_REQUEST);
}

/// A request that is refused is not remembered: mended, it may be sent under the same key.
#[tokio::test]
async fn a_refused_request_leaves_its_key_free() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let wrong = json!({ "agent": "a", "suite": "none" });
    assert_eq!(post(&service, "/v1/runs", "k", &wrong).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    let right = json!({ "agent": "a", "suite": "mineceraft" });
    assert_eq!(post(&service, "/v1/runs", "k", &right).await.status, StatusCode::CREATED);
}

/// Fifty at once: one run, and nobody is told of another.
#[tokio::test]
async fn many_at_once_make_one() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let run = json!({ "agent": "a", "suite": "mineceraft" });
    let mut ids = std::collections::BTreeSet::new();
    let answers = futures_util::future::join_all((0..50).map(|_| post(&service, "/v1/runs", "k", &run))).await;
    for answer in answers {
        match answer.status {
            StatusCode::CREATED => {
                ids.insert(answer.json()["id"].as_str().unwrap().to_owned());
            }
            StatusCode::CONFLICT => assert!(answer.headers.contains_key("retry-after")),
            other => panic!("{other}: {}", answer.text),
        }
    }
    assert_eq!(ids.len(), 1);
}
