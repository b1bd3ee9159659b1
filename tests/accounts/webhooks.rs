//! Webhooks: events of an owner, posted to an endpoint that answers as tests wish.

use std::path::Path;
use std::time::Duration;

use crate::support::commands::{key, plumbline, succeeded};
use crate::support::endpoint::Endpoint;
use crate::support::{Answer, Service};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

async fn ask(service: &Service, key: &str, method: Method, path: &str, body: Option<Value>) -> Answer {
    let request = service.http.request(method, format!("{}{path}", service.url)).bearer_auth(key);
    service.send(if let Some(body) = body { request.json(&body) } else { request }).await
}

async fn webhook(service: &Service, key: &str, endpoint: &Endpoint, events: Value) -> String {
    let made =
        ask(service, key, Method::POST, "/v1/webhooks", Some(json!({ "url": endpoint.url, "events": events }))).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text);
    assert!(made.json()["secret"].as_str().unwrap().starts_with("whsec_"));
    made.json()["id"].as_str().unwrap().to_owned()
}

/// Returns the deliveries of a webhook once all of them have ended. If a kill cuts off an attempt, the next one follows
/// after a minute.
async fn ended(service: &Service, key: &str, id: &str, count: usize) -> Vec<Value> {
    let path = format!("/v1/webhooks/{id}/deliveries");
    for _ in 0..900 {
        let list = ask(service, key, Method::GET, &path, None).await.json()["deliveries"].as_array().unwrap().clone();
        if list.len() == count && list.iter().all(|delivery| delivery["state"] != "pending") {
            return list;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("{}", ask(service, key, Method::GET, &path, None).await.text);
}

fn start(database: &Path, retries: &str) -> Service {
    Service::start_as_told(database, &["--webhooks-to-private-addresses", "--webhook-retry-seconds", retries])
}

async fn post_empty_log(service: &Service, key: &str) {
    let log = json!({ "task": 113, "turns": [{ "events": [] }] });
    let accepted = ask(service, key, Method::POST, "/v1/submissions", Some(log)).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
}

#[tokio::test]
async fn events_of_an_owner_are_posted_and_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = start(&database, "1,1");
    let (ours, theirs) = (key(&database, "us"), key(&database, "them"));
    let (all, some) = (Endpoint::start(&[503, 302, 204]).await, Endpoint::start(&[200]).await);
    let everything = webhook(&service, &ours, &all, Value::Null).await;
    let finished = webhook(&service, &ours, &some, json!(["run.finished"])).await;
    post_empty_log(&service, &theirs).await;
    post_empty_log(&service, &ours).await;

    // One message, in three attempts: it keeps its identifier and its text.
    let received = all.wait_for(3).await;
    assert!(received.iter().all(|message| *message == received[0]), "{received:?}");
    let (id, message) = &received[0];
    assert_eq!([&message["type"], &message["data"]["state"]], [&json!("submission.graded"), &json!("graded")]);
    assert_eq!(message["data"]["task"], "walls/5x1x5-raise");
    assert!(message["timestamp"].as_str().unwrap().ends_with('Z'));
    let list = ended(&service, &ours, &everything, 1).await;
    assert_eq!([&list[0]["id"], &list[0]["state"], &list[0]["attempts"]], [&json!(id), &json!("delivered"), &json!(3)]);
    assert_eq!(list[0]["message"], *message);

    // The end of a run is an event too; those of other owners are not theirs to see.
    service.use_key(Some(&ours));
    let run = service.finished_run("agent", 25).await;
    let received = some.wait_for(1).await;
    assert_eq!([&received[0].1["type"], &received[0].1["data"]["run"]], [&json!("run.finished"), &json!(run)]);
    assert_eq!(all.wait_for(3 + 26).await.len(), 29);
    assert_eq!(some.received.lock().unwrap().len(), 1);
    for (method, path) in [
        (Method::GET, format!("/v1/webhooks/{everything}")),
        (Method::DELETE, format!("/v1/webhooks/{everything}")),
        (Method::GET, format!("/v1/webhooks/{everything}/deliveries")),
        (Method::POST, format!("/v1/webhooks/{everything}/test")),
        (Method::POST, format!("/v1/webhooks/{everything}/secret")),
        (Method::POST, format!("/v1/webhooks/{everything}/deliveries/{id}/retry")),
        (Method::POST, format!("/v1/webhooks/{finished}/deliveries/{id}/retry")),
    ] {
        let by = if path.contains(&finished) { &ours } else { &theirs };
        assert_eq!(ask(&service, by, method, &path, None).await.status, StatusCode::NOT_FOUND, "{path}");
    }

    // A delivery that was made can be made again.
    let again = format!("/v1/webhooks/{everything}/deliveries/{id}/retry");
    assert_eq!(ask(&service, &ours, Method::POST, &again, None).await.status, StatusCode::ACCEPTED);
    assert_eq!(all.wait_for(30).await[29].0, *id);

    // 410 disables the webhook; a later event is not posted, and not when it is enabled again either.
    some.answer_with(410);
    assert_eq!(
        ask(&service, &ours, Method::POST, &format!("/v1/webhooks/{finished}/test"), None).await.status,
        StatusCode::ACCEPTED
    );
    some.wait_for(2).await;
    let dead = &ended(&service, &ours, &finished, 2).await[0];
    assert_eq!(
        [&dead["event"], &dead["state"], &dead["last_status"]],
        [&json!("webhook.test"), &json!("dead"), &json!(410)]
    );
    let path = format!("/v1/webhooks/{finished}");
    let state = ask(&service, &ours, Method::GET, &path, None).await;
    assert_eq!(state.json()["disabled_reason"], "the endpoint answered 410 Gone");
    assert!(!state.text.contains("whsec_"), "a secret is shown once");
    let refused = ask(&service, &ours, Method::POST, &format!("{path}/test"), None).await;
    assert_eq!(
        (refused.status, refused.json()["type"].as_str()),
        (StatusCode::CONFLICT, Some("urn:plumbline:problem:webhook-disabled"))
    );
    service.finished_run("agent", 25).await;
    some.answer_with(200);
    // What a change leaves out stays as it is.
    let renamed = ask(&service, &ours, Method::PUT, &path, Some(json!({ "url": some.url }))).await.json();
    assert_eq!([&renamed["enabled"], &renamed["events"]], [&json!(false), &json!(["run.finished"])]);
    let body = json!({ "enabled": true, "events": ["run.finished", "run.deleted"] });
    let enabled = ask(&service, &ours, Method::PUT, &path, Some(body)).await;
    assert_eq!(
        [&enabled.json()["enabled"], &enabled.json()["events"]],
        [&json!(true), &json!(["run.finished", "run.deleted"])]
    );
    let third = service.finished_run("agent", 25).await;
    assert_eq!(some.wait_for(3).await[2].1["data"]["run"], json!(third));

    // A deleted webhook receives no more.
    assert_eq!(ask(&service, &ours, Method::DELETE, &path, None).await.status, StatusCode::OK);
    assert_eq!(
        ask(&service, &ours, Method::GET, "/v1/webhooks", None).await.json()["webhooks"].as_array().unwrap().len(),
        1
    );
}

#[tokio::test]
async fn a_message_that_nobody_takes_is_kept_as_dead_and_a_crash_loses_none() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = start(&database, "1");
    let ours = key(&database, "us");
    let endpoint = Endpoint::start(&[500]).await;
    let id = webhook(&service, &ours, &endpoint, Value::Null).await;
    post_empty_log(&service, &ours).await;
    let dead = ended(&service, &ours, &id, 1).await;
    let seen =
        json!({ "state": dead[0]["state"], "attempts": dead[0]["attempts"], "last_error": dead[0]["last_error"] });
    assert_eq!(seen, json!({ "state": "dead", "attempts": 2, "last_error": "500 Internal Server Error" }));
    let listed = ask(&service, &ours, Method::GET, &format!("/v1/webhooks/{id}/deliveries?state=dead"), None).await;
    assert_eq!(listed.json()["deliveries"].as_array().unwrap().len(), 1);
    let delivered =
        ask(&service, &ours, Method::GET, &format!("/v1/webhooks/{id}/deliveries?state=delivered"), None).await;
    assert_eq!(delivered.json()["deliveries"], json!([]));

    let listed = succeeded(&plumbline(&["webhooks", "list"], &database));
    let row = listed.lines().find(|line| line.contains(&id)).unwrap();
    let cells: Vec<&str> = row.split('|').map(str::trim).collect();
    assert_eq!(cells[6..=9], ["0", "1", "500 Internal Server Error", "enabled"], "{listed}");

    // Messages wait while the service is dead, under the identifiers that they have.
    service.kill();
    let service = start(&database, "1,1,1,1,1,1,1,1,1");
    post_empty_log(&service, &ours).await;
    let before = endpoint.wait_for(3).await[2].0.clone();
    service.kill();
    endpoint.answer_with(200);
    let service = start(&database, "1,1,1,1,1,1,1,1,1");
    let list = ended(&service, &ours, &id, 2).await;
    assert_eq!([&list[0]["id"], &list[0]["state"]], [&json!(before), &json!("delivered")], "{list:?}");
}

#[tokio::test]
async fn a_message_that_waits_holds_up_no_others_and_comes_once_the_endpoint_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = start(&database, "600");
    let ours = key(&database, "us");
    let endpoint = Endpoint::start(&[500, 200]).await;
    let id = webhook(&service, &ours, &endpoint, json!(["run.finished", "run.deleted"])).await;
    service.use_key(Some(&ours));
    let first = service.finished_run("agent", 25).await;
    assert_eq!(endpoint.wait_for(1).await[0].1["data"]["run"], json!(first));
    // More events that were not chosen than there is room for messages beside the one that waits.
    let log = json!({ "task": 113, "turns": [{ "events": [] }] }).to_string();
    let lines = vec![log; 1_000].join("\n");
    let accepted = service.post("/v1/submissions", "application/x-ndjson", lines).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
    let second = service.finished_run("agent", 25).await;
    let received = endpoint.wait_for(3).await;
    assert_eq!(received[1].1["data"]["run"], json!(second), "{received:?}");
    assert_eq!(received[2], received[0], "the endpoint is back, so nothing waits");
    assert_eq!(ended(&service, &ours, &id, 2).await.len(), 2);

    // The operator sees and stops what owners do.
    let command = |arguments: &[&str]| succeeded(&plumbline(&[&["webhooks"], arguments].concat(), &database));
    let listed = command(&["list"]);
    assert!(
        listed.contains(&id) && listed.contains("run.finished,run.deleted") && !listed.contains("whsec_"),
        "{listed}"
    );
    command(&["disable", &id, "--reason", "it floods others"]);
    let state = ask(&service, &ours, Method::GET, &format!("/v1/webhooks/{id}"), None).await;
    assert_eq!(state.json()["disabled_reason"], "disabled by the operator: it floods others");
}

#[tokio::test]
async fn webhooks_do_not_lead_into_the_network_of_the_service() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &["--webhook-retry-seconds", "0"]);
    let ours = key(&database, "us");
    for (body, faults) in [
        (json!({ "url": "http://lab.example/" }), vec!["null /url"]),
        (json!({ "url": "https://169.254.169.254/latest/meta-data" }), vec!["null /url"]),
        (json!({ "url": "https://lab.example/", "events": [] }), vec!["null /events"]),
        (json!({ "url": "https://lab.example/", "events": ["run.started"] }), vec!["null /events/0"]),
        (json!({ "events": null }), vec!["null /url"]),
    ] {
        let refused = ask(&service, &ours, Method::POST, "/v1/webhooks", Some(body.clone())).await;
        assert_eq!(refused.faults(422), faults, "{body}: {}", refused.text);
    }
    // A name that leads to this machine is refused when it is looked up.
    let body = json!({ "url": "https://localhost:9/?token=secret-token" });
    let made = ask(&service, &ours, Method::POST, "/v1/webhooks", Some(body)).await.json();
    let id = made["id"].as_str().unwrap();
    ask(&service, &ours, Method::POST, &format!("/v1/webhooks/{id}/test"), None).await;
    let dead = ended(&service, &ours, id, 1).await;
    let error = dead[0]["last_error"].as_str().unwrap();
    assert!(error.contains("\"localhost\" has no address of the public internet"), "{error}");
    assert!(!error.contains("secret-token"), "{error}");
    assert!(service.get("/v1/webhooks").await.status == StatusCode::UNAUTHORIZED);
    for i in 0..9 {
        let body = json!({ "url": format!("https://lab.example/{i}") });
        assert_eq!(ask(&service, &ours, Method::POST, "/v1/webhooks", Some(body)).await.status, StatusCode::CREATED);
    }
    let body = json!({ "url": "https://lab.example/" });
    let full = ask(&service, &ours, Method::POST, "/v1/webhooks", Some(body)).await;
    assert_eq!(full.json()["type"], "urn:plumbline:problem:too-many-webhooks");
}
