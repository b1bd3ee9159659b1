//! Cards: what a run or an entry was, as its owner declares it, with every edit.

use crate::support::Service;
use crate::support::commands::{plumbline, succeeded};
use crate::support::epoch::Scene;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

const PROMPT: &str = "You are a builder.\n\tBuild — 石 — well.\n";

#[tokio::test]
async fn a_card_is_declared_edited_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let key = |owner: &str| succeeded(&plumbline(&["keys", "create", "--name", owner], &database)).trim().to_owned();
    let (lab, other) = (key("lab"), key("other"));
    let send = async |method: Method, path: &str, key: &str, body: &Value| {
        service.send(service.http.request(method, format!("{}{path}", service.url)).bearer_auth(key).json(body)).await
    };
    let card = json!({
        "model": { "name": "m-7b", "openness": "open-weights" }, "system_prompt": { "text": PROMPT },
        "tokens": { "input": 1_000, "output": null }, "cost": null,
    });
    let begun = json!({ "agent": "carded", "suite": "mineceraft-lite", "card": card });
    let run = send(Method::POST, "/v1/runs", &lab, &begun).await;
    assert_eq!(run.status, StatusCode::CREATED, "{}", run.text);
    let shown = run.json()["card"].clone();
    assert_eq!(shown["model"], json!({ "name": "m-7b", "openness": "open-weights" }));
    assert_eq!(shown["tokens"], json!({ "input": 1_000 }), "what is unknown is left out, and never 0");
    assert!(!run.text.contains("Build"), "the prompt is shown on request: {}", run.text);
    let path = format!("/v1/runs/{}", run.json()["id"].as_str().unwrap());
    let asked = service.get(&format!("{path}/card?prompt=true")).await.json();
    assert_eq!(asked["versions"][0]["card"]["system_prompt"]["text"], PROMPT);

    // It is edited after the run has ended, and every version stays.
    send(Method::POST, &format!("{path}/finish"), &lab, &json!({ "skip": "unanswered" })).await;
    let cost = json!({ "amount": 1.25, "currency": "EUR", "prices_as_of": "2026-11-01" });
    let edited = json!({ "model": { "name": "m-7b", "revision": "b" }, "cost": cost });
    let put = send(Method::PUT, &format!("{path}/card"), &lab, &edited).await;
    assert_eq!(put.status, StatusCode::OK, "{}", put.text);
    let versions = service.get(&format!("{path}/card")).await.json()["versions"].clone();
    assert_eq!((&versions[0]["version"], &versions[0]["card"]), (&json!(2), &edited));
    assert_eq!((&versions[1]["card"], &versions[1]["actor"]), (&shown, &json!("lab")));
    assert_eq!(service.get(&path).await.json()["card"], edited);
    assert_eq!(service.get("/v1/runs?agent=carded").await.json()["runs"][0]["card"], edited);
    let page = service.get(&path.replace("/v1", "")).await.text;
    assert!(page.contains("m-7b") && page.contains("1.25 EUR"), "{page}");

    let refused = send(Method::PUT, &format!("{path}/card"), &other, &edited).await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN, "{}", refused.text);
    let faulty = json!({ "system_prompt": { "text": "a\0b" } });
    let refused = send(Method::PUT, &format!("{path}/card"), &lab, &faulty).await;
    assert_eq!(refused.faults(422), ["null /system_prompt/text"], "PostgreSQL stores no U+0000");
    let faulty = json!({ "cost": { "amount": 0, "currency": "EUR", "prices_as_of": "today" }, "modle": "x" });
    let refused = send(Method::PUT, &format!("{path}/card"), &lab, &faulty).await;
    assert_eq!(refused.faults(422), ["null /modle", "null /cost/amount", "null /cost/prices_as_of"]);
    let refused = json!({ "agent": "a", "suite": "mineceraft", "card": faulty });
    let refused = send(Method::POST, "/v1/runs", &lab, &refused).await;
    assert_eq!(refused.faults(422), ["null /card/modle", "null /card/cost/amount", "null /card/cost/prices_as_of"]);
    assert_eq!(service.get("/v1/runs/none/card").await.status, StatusCode::NOT_FOUND);
    // The same card again is no edit.
    let again = send(Method::PUT, &format!("{path}/card"), &lab, &edited).await.json();
    assert_eq!(again["versions"], versions);
    let numbered = |version: u32| json!({ "agent_version": version.to_string() });
    for version in 2..100 {
        let put = send(Method::PUT, &format!("{path}/card"), &lab, &numbered(version)).await;
        assert_eq!(put.status, StatusCode::OK, "{}", put.text);
    }
    let full = send(Method::PUT, &format!("{path}/card"), &lab, &numbered(100)).await;
    assert_eq!(
        (full.status, full.json()["type"].as_str()),
        (StatusCode::CONFLICT, Some("urn:plumbline:problem:card-full"))
    );
}

#[tokio::test]
async fn an_entry_has_a_card_too() {
    let scene = Scene::new(&[]);
    let (lab, other) = (scene.key("lab"), scene.key("other"));
    let entry = scene.register(&lab, "dev", 1).await;
    let path = format!("/v1/entries/{entry}/card");
    let service = &scene.service;
    assert_eq!(service.get(&path).await.status, StatusCode::NOT_FOUND);
    let card = json!({ "model": { "name": "m-7b" } });
    let put = async |key: &str| {
        service.send(service.http.put(format!("{}{path}", service.url)).bearer_auth(key).json(&card)).await.status
    };
    assert_eq!((put(&other).await, put(&lab).await), (StatusCode::FORBIDDEN, StatusCode::OK));
    assert_eq!(service.get(&path).await.json()["versions"][0]["card"], card);
}
