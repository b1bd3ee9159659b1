//! Teams: members of an owner with roles, and the keys that belong to them.

use std::time::Duration;

use crate::support::commands::{key, plumbline, refused, succeeded};
use crate::support::{Answer, Service};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

async fn ask(service: &Service, key: &str, method: Method, path: &str, body: Option<Value>) -> Answer {
    let request = service.http.request(method, format!("{}{path}", service.url)).bearer_auth(key);
    service.send(if let Some(body) = body { request.json(&body) } else { request }).await
}

/// A key is looked up again after half a second.
async fn wait_until_keys_are_read_again() {
    tokio::time::sleep(Duration::from_millis(700)).await;
}

#[tokio::test]
async fn keys_of_members_do_what_their_roles_allow() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let (lab, others) = (key(&database, "lab"), key(&database, "others"));
    let put = |name: &str, role: &str| (format!("/v1/team/members/{name}"), json!({ "role": role }));
    for (name, role, status) in [
        ("Ana María 王", "manager", StatusCode::CREATED),
        ("trainer", "manager", StatusCode::CREATED),
        ("trainer", "reader", StatusCode::OK),
    ] {
        let (path, body) = put(&name.replace(' ', "%20"), role);
        let answer = ask(&service, &lab, Method::PUT, &path, Some(body)).await;
        assert_eq!(answer.status, status, "{name} {role}: {}", answer.text);
    }
    let new_key = async |by: &str, member: &str, body: Value| {
        ask(&service, by, Method::POST, &format!("/v1/team/members/{member}/keys"), Some(body)).await
    };
    let created = new_key(&lab, "trainer", json!({ "expires_days": 30 })).await;
    assert_eq!(created.status, StatusCode::CREATED, "{}", created.text);
    assert_eq!(created.json()["about"]["scopes"], json!(["grade", "read"]), "what a reader may have");
    let trainer = created.json()["key"].as_str().unwrap().to_owned();
    let wide = new_key(&lab, "trainer", json!({ "scopes": ["grade", "submit", "admin"], "expires_days": 0 })).await;
    assert_eq!(wide.faults(422), ["null /expires_days", "null /scopes/1", "null /scopes/2"]);
    assert_eq!(new_key(&lab, "trainer", json!({ "scopes": ["root"] })).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    for (body, faults) in [
        (json!(["reader"]), "null "),
        (json!({ "role": null }), "null /role"),
        (json!({ "role": { "reader": null } }), "null /role"),
        (json!({ "role": "boss" }), "null /role"),
    ] {
        let refused = ask(&service, &lab, Method::PUT, "/v1/team/members/x", Some(body.clone())).await;
        assert_eq!(refused.faults(422), [faults], "{body}: {}", refused.text);
    }
    let many = new_key(&lab, "trainer", json!({ "scopes": ["bogus", null, 3], "expires_days": 1.5, "x": 1 })).await;
    assert_eq!(
        many.faults(422),
        ["null /expires_days", "null /scopes/0", "null /scopes/1", "null /scopes/2", "null /x"]
    );
    assert_eq!(new_key(&lab, "nobody", json!({})).await.status, StatusCode::NOT_FOUND);
    assert_eq!(new_key(&others, "trainer", json!({})).await.status, StatusCode::NOT_FOUND, "another team");

    // A reader grades, and neither begins runs nor manages anything.
    let log = json!({ "task": 113, "turns": [{ "events": [] }] });
    let run = json!({ "agent": "a", "suite": "mineceraft-lite" });
    let post =
        async |key: &str, path: &str, body: &Value| ask(&service, key, Method::POST, path, Some(body.clone())).await;
    assert_eq!(post(&trainer, "/v1/grade", &log).await.status, StatusCode::OK);
    assert_eq!(post(&trainer, "/v1/runs", &run).await.status, StatusCode::FORBIDDEN);
    let (path, body) = put("trainer", "manager");
    assert_eq!(ask(&service, &trainer, Method::PUT, &path, Some(body)).await.status, StatusCode::FORBIDDEN);

    // Its role changes what its key may do: a submitter begins runs, which are the owner's, but withdraws none.
    let (path, body) = put("trainer", "submitter");
    ask(&service, &lab, Method::PUT, &path, Some(body)).await;
    let second = new_key(&trainer, "trainer", json!({})).await;
    assert_eq!(second.status, StatusCode::FORBIDDEN, "its key only grades and reads, and makes no others");
    let second = new_key(&lab, "trainer", json!({})).await.json();
    let submitter = second["key"].as_str().unwrap().to_owned();
    assert_eq!(new_key(&lab, "trainer", json!({})).await.json()["type"], "urn:plumbline:problem:too-many-keys");
    let begun = post(&submitter, "/v1/runs", &run).await;
    assert_eq!((begun.status, &begun.json()["owner"]), (StatusCode::CREATED, &json!("lab")), "{}", begun.text);
    let id = begun.json()["id"].as_str().unwrap().to_owned();
    let withdrawal = post(&submitter, &format!("/v1/runs/{id}/withdraw"), &json!({ "reason": "r" })).await;
    assert_eq!(withdrawal.status, StatusCode::FORBIDDEN, "{}", withdrawal.text);
    let manager =
        new_key(&lab, "Ana%20Mar%C3%ADa%20%E7%8E%8B", json!({})).await.json()["key"].as_str().unwrap().to_owned();
    let withdrawal = post(&manager, &format!("/v1/runs/{id}/withdraw"), &json!({ "reason": "r" })).await;
    assert_eq!(withdrawal.status, StatusCode::CONFLICT, "it may, but the run is open: {}", withdrawal.text);

    // A key neither outlives the one that made it nor has a scope more.
    let short = succeeded(&plumbline(
        &["keys", "create", "--name", "brief", "--scopes", "submit", "--expires", "12h"],
        &database,
    ));
    ask(&service, &short, Method::PUT, "/v1/team/members/x", Some(json!({ "role": "manager" }))).await;
    let made = new_key(&short, "x", json!({ "expires_days": 30 })).await.json();
    assert_eq!(made["about"]["scopes"], json!(["submit"]), "{made}");
    let team = ask(&service, &short, Method::GET, "/v1/team", None).await.json();
    assert_eq!(made["about"]["expires_at"], team["keys"][0]["expires_at"]);
    assert_eq!(new_key(&short, "x", json!({ "scopes": ["grade"] })).await.faults(422), ["null /scopes/0"]);

    // A member revokes its own keys and no others.
    let id_of = |key: &str| key.split('_').nth(1).unwrap().to_owned();
    let revoke = async |by: &str, key: &str| {
        ask(&service, by, Method::DELETE, &format!("/v1/team/keys/{}", id_of(key)), None).await
    };
    assert_eq!(revoke(&submitter, &manager).await.status, StatusCode::FORBIDDEN);
    assert_eq!(revoke(&others, &manager).await.status, StatusCode::NOT_FOUND);
    assert_eq!(revoke(&submitter, &trainer).await.status, StatusCode::OK);
    let team = ask(&service, &lab, Method::GET, "/v1/team", None).await;
    let member = &team.json()["members"][1];
    assert_eq!((member["name"].as_str(), member["keys"].as_array().unwrap().len()), (Some("trainer"), 1), "{member}");
    for key in [&trainer, &submitter, &manager] {
        assert!(!team.text.contains(key.rsplit('_').next().unwrap()), "a secret is shown once");
    }

    // Whoever is removed has no key any more, also when somebody of the same name follows.
    let path = "/v1/team/members/trainer";
    assert_eq!(ask(&service, &manager, Method::DELETE, path, None).await.status, StatusCode::OK);
    assert_eq!(ask(&service, &manager, Method::DELETE, path, None).await.status, StatusCode::NOT_FOUND);
    wait_until_keys_are_read_again().await;
    assert_eq!(post(&submitter, "/v1/runs", &run).await.status, StatusCode::UNAUTHORIZED);
    let (path, body) = put("trainer", "submitter");
    ask(&service, &lab, Method::PUT, &path, Some(body)).await;
    wait_until_keys_are_read_again().await;
    assert_eq!(post(&submitter, "/v1/runs", &run).await.status, StatusCode::UNAUTHORIZED);
    assert_eq!(service.get("/v1/team").await.status, StatusCode::UNAUTHORIZED);
    let (path, body) = put("%09", "reader");
    assert_eq!(ask(&service, &lab, Method::PUT, &path, Some(body)).await.status, StatusCode::BAD_REQUEST);
}

#[tokio::test]
async fn a_manager_who_was_removed_does_not_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let lab = key(&database, "lab");
    let (path, body) = ("/v1/team/members/mallory", json!({ "role": "manager" }));
    ask(&service, &lab, Method::PUT, path, Some(body.clone())).await;
    let made = ask(&service, &lab, Method::POST, &format!("{path}/keys"), Some(json!({}))).await.json();
    let mallory = made["key"].as_str().unwrap();
    assert_eq!(ask(&service, mallory, Method::GET, "/v1/team", None).await.status, StatusCode::OK);
    assert_eq!(ask(&service, &lab, Method::DELETE, path, None).await.status, StatusCode::OK);
    // The service still remembers the key, for half a second. The member's own keys are no way back either.
    let own = ask(&service, mallory, Method::POST, &format!("{path}/keys"), None).await;
    assert_eq!(own.status, StatusCode::UNAUTHORIZED, "{}", own.text);
    let back = ask(&service, mallory, Method::PUT, path, Some(body)).await;
    assert_eq!(back.status, StatusCode::UNAUTHORIZED, "{}", back.text);
    let made = ask(&service, mallory, Method::POST, "/v1/team/members/x/keys", None).await;
    assert_eq!(made.status, StatusCode::UNAUTHORIZED, "{}", made.text);
}

#[test]
fn operators_make_keys_of_members() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    succeeded(&plumbline(&["migrate", "--create"], &database));
    let create = |rest: &[&str]| plumbline(&[&["keys", "create", "--name", "lab"], rest].concat(), &database);
    assert!(refused(&create(&["--member", "ana"])).contains("has no member \"ana\"; add --role"));
    assert!(refused(&create(&["--member", "ana", "--role", "boss"])).contains("not one of reader, submitter, manager"));
    succeeded(&create(&["--member", "ana", "--role", "reader"]));
    let wide = refused(&create(&["--member", "ana", "--scopes", "submit"]));
    assert!(wide.contains("role of the member does not allow \"submit\""), "{wide}");
    succeeded(&create(&["--member", "ana"]));
    assert!(refused(&create(&["--member", "ana"])).contains("\"ana\" has 2 live keys"));
    // What is refused changes no role.
    assert!(refused(&create(&["--member", "ana", "--role", "manager"])).contains("\"ana\" has 2 live keys"));
    // Keys of members do not count among those of the owner.
    succeeded(&create(&[]));
    let listed = succeeded(&plumbline(&["keys", "list"], &database));
    assert!(listed.contains("ana (reader)") && listed.contains("grade,read"), "{listed}");
}
