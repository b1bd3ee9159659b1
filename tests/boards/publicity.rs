//! What an owner decides about a run in public: an embargo, and a withdrawal.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::support::Service;
use crate::support::commands::{key, plumbline, succeeded};
use reqwest::StatusCode;
use serde_json::{Value, json};

const BOARD: &str = "/v1/leaderboards/mineceraft-lite";

/// What only the owner of an anonymous run may see.
const SECRETS: [&str; 4] = ["Secret Model", "quiet-lab", "m-secret-7b", "internal-ticket"];

fn in_days(days: u64) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap() + Duration::from_secs(days * 86_400);
    jiff::Timestamp::from_second(now.as_secs().try_into().unwrap()).unwrap().to_string()
}

fn anonymous_run(alias: &str, until: &str) -> Value {
    json!({
        "agent": "Secret Model", "suite": "mineceraft-lite", "metadata": { "ticket": "internal-ticket" },
        "card": { "model": { "name": "m-secret-7b" }, "configuration_sha256": "a".repeat(64) },
        "embargo": { "alias": alias, "until": until },
    })
}

/// Asserts that no public door shows what is secret.
async fn look_at_every_door(service: &Service, run: &str, other: &str) {
    let submissions = service.get(&format!("/v1/runs/{run}/submissions")).await.json();
    let submission = submissions["submissions"][0]["id"].as_str().unwrap().to_owned();
    let doors = [
        format!("/v1/runs/{run}"),
        "/v1/runs".to_owned(),
        "/v1/runs?agent=maple".to_owned(),
        format!("/v1/runs/{run}/card"),
        format!("/v1/runs/{run}/card?prompt=true"),
        format!("/v1/runs/{run}/submissions"),
        format!("/v1/submissions/{submission}"),
        format!("/v1/submissions/{submission}/report"),
        format!("/v1/events?run={run}"),
        BOARD.to_owned(),
        format!("{BOARD}?format=csv"),
        format!("{BOARD}?format=ndjson"),
        format!("{BOARD}?coverage=incomplete"),
        format!("{BOARD}/repeats"),
        format!("{BOARD}/actions"),
        format!("{BOARD}/feed.atom"),
        format!("{BOARD}/breakdown?by=family"),
        format!("{BOARD}/compare?a={run}&b={other}"),
        "/v1/receipts".to_owned(),
        "/metrics".to_owned(),
        "/".to_owned(),
        "/boards/mineceraft-lite".to_owned(),
        format!("/boards/mineceraft-lite/compare?a={run}&b={other}"),
        format!("/boards/mineceraft-lite/compare.csv?a={run}&b={other}"),
        format!("/runs/{run}"),
        "/agents/maple-7".to_owned(),
        "/search?text=e".to_owned(),
        "/boards/mineceraft-lite/charts".to_owned(),
        "/boards/mineceraft-lite/charts/progress.svg".to_owned(),
        "/boards/mineceraft-lite/charts/profile.csv".to_owned(),
        "/boards/mineceraft-lite/log".to_owned(),
        format!("{BOARD}?format=markdown"),
        format!("/submissions/{submission}"),
        format!("/submissions/{submission}/evidence.html"),
        format!("/suites/mineceraft-lite/tasks/{}", submissions["submissions"][0]["number"]),
    ];
    for door in doors {
        let answer = service.get(&door).await;
        for secret in SECRETS {
            assert!(!answer.text.contains(secret), "{door} shows {secret}: {}", answer.text);
        }
        let needs_no_run = ["/card", "/actions", "/repeats", "/metrics"].iter().any(|part| door.contains(part));
        assert!(answer.status == StatusCode::OK || needs_no_run, "{door}: {} {}", answer.status, answer.text);
    }
    let secret_search = service.get("/v1/runs?agent=Secret").await.json();
    assert_eq!(secret_search["runs"], json!([]), "a search does not find what it may not show");
    assert!(service.get("/search?text=Secret").await.text.contains("Nothing contains"));
    assert_eq!(service.get("/agents/Secret%20Model").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn an_anonymous_run_shows_its_alias_until_its_embargo_is_lifted() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = Service::start_as_told(&database, &[]);
    let (ours, theirs) = (key(&database, "quiet-lab"), key(&database, "others"));
    service.use_key(Some(&theirs));
    let other = service.finished_run("Public Model", 3).await;
    service.use_key(Some(&ours));
    let until = in_days(30);
    for (alias, until, pointer) in [
        ("Public Model", until.as_str(), "/embargo/alias"),
        ("Secret Model", until.as_str(), "/embargo/alias"),
        ("maple\u{0}7", until.as_str(), "/embargo/alias"),
        ("maple\n\u{1b}[31m7", until.as_str(), "/embargo/alias"),
        ("maple-7", "2020-01-01", "/embargo/until"),
    ] {
        let refused = service.post_json("/v1/runs", &anonymous_run(alias, until)).await;
        assert_eq!(refused.faults(422), [format!("null {pointer}")], "{alias} {until}: {}", refused.text);
    }
    let begun = service.post_json("/v1/runs", &anonymous_run("maple-7", &until)).await;
    assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.text);
    let run = begun.json()["id"].as_str().unwrap().to_owned();
    service.answer_run(&run, 1).await;
    // The owner sees all of it.
    let own = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!(own["embargo"]["agent"], "Secret Model");
    assert_eq!([&own["agent"], &own["owner"]], [&json!("maple-7"), &json!("quiet-lab")]);
    assert_eq!(own["metadata"]["ticket"], "internal-ticket");
    assert_eq!(own["card"]["model"]["name"], "m-secret-7b");
    assert_eq!(service.get("/v1/runs?mine=true").await.json()["runs"][0]["embargo"]["agent"], "Secret Model");

    // Others see the alias, with or without a key, and until when.
    service.use_key(Some(&theirs));
    let posing = json!({ "agent": "maple-7", "suite": "mineceraft-lite" });
    assert_eq!(service.post_json("/v1/runs", &posing).await.faults(422), ["null /agent"]);
    for key in [Some(theirs.as_str()), None] {
        service.use_key(key);
        let seen = service.get(&format!("/v1/runs/{run}")).await.json();
        assert_eq!([&seen["agent"], &seen["owner"], &seen["metadata"]], [&json!("maple-7"), &Value::Null, &json!({})]);
        assert!(seen["embargo"]["until"].as_str().unwrap().starts_with(&until[..16]), "{seen}");
        let row = service.get(BOARD).await.json()["rows"][0].clone();
        assert_eq!([&row["agent"], &row["attempts"]], [&json!("maple-7"), &json!(1)]);
        assert_eq!(row["anonymous_until"], seen["embargo"]["until"]);
        look_at_every_door(&service, &run, &other).await;
    }
    assert!(service.get("/boards/mineceraft-lite").await.text.contains("anonymous until"));
    assert!(service.get(&format!("/runs/{run}")).await.text.contains("Anonymous until"));

    // A key that may stand in a URL sees no more than others.
    let grade = succeeded(&plumbline(&["keys", "create", "--name", "quiet-lab", "--scopes", "grade,read"], &database));
    service.use_key(Some(&grade));
    assert_eq!(service.get(&format!("/v1/runs/{run}")).await.json()["owner"], Value::Null);

    // A run of another owner with the same logs is not flagged before the embargo ends: that would tell whose it is
    // not.
    service.use_key(Some(&theirs));
    let copy = service.finished_run("Copy", 1).await;
    let similar = |board: &Value, run: &str| {
        let rows = board["rows"].as_array().unwrap();
        rows.iter().find(|row| row["run"] == run).unwrap()["similar_to"].clone()
    };
    let before = service.get(BOARD).await.json();
    assert_eq!([similar(&before, &run), similar(&before, &copy)], [json!([]), json!([])]);

    // Nobody else lifts the embargo. Its owner does, and boards in memory learn of it.
    service.use_key(Some(&theirs));
    let lift = service.http.delete(format!("{}/v1/runs/{run}/embargo", service.url));
    assert_eq!(service.send(lift).await.status, StatusCode::FORBIDDEN);
    service.use_key(Some(&ours));
    let lift = || service.http.delete(format!("{}/v1/runs/{run}/embargo", service.url));
    let lifted = service.send(lift()).await;
    assert_eq!((lifted.status, &lifted.json()["agent"]), (StatusCode::OK, &json!("Secret Model")), "{}", lifted.text);
    assert_eq!(service.send(lift()).await.json()["type"], "urn:plumbline:problem:no-embargo");
    service.use_key(None);
    let row = service.get(BOARD).await.json()["rows"][0].clone();
    assert_eq!([&row["agent"], &row["attempts"]], [&json!("Secret Model"), &json!(1)]);
    assert_eq!(row.get("anonymous_until"), None);
    let actions = service.get(&format!("{BOARD}/actions")).await.json();
    assert_eq!(actions["actions"][0]["action"], "reveal", "{actions}");
    let after = service.get(BOARD).await.json();
    let has = |of: &str, other: &str| similar(&after, of).as_array().unwrap().contains(&json!(other));
    assert!(has(&run, &copy) && has(&copy, &run), "{after}");
    let open = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!([&open["owner"], &open["metadata"]["ticket"]], [&json!("quiet-lab"), &json!("internal-ticket")]);
    assert!(service.get(&format!("/v1/runs/{run}/card")).await.text.contains("m-secret-7b"));

    // An embargo that is over ends by itself, also for a run that has not finished.
    service.use_key(Some(&ours));
    let soon = jiff::Timestamp::now() + jiff::SignedDuration::from_secs(5);
    let short = service.post_json("/v1/runs", &anonymous_run("maple-8", &soon.to_string())).await.json();
    service.use_key(None);
    let path = format!("/v1/runs/{}", short["id"].as_str().unwrap());
    assert_eq!(service.get(&path).await.json()["agent"], "maple-8");
    service.wait_for(&path, |run| run["agent"] == "Secret Model").await;
    let row = service.get(BOARD).await.json()["rows"][0].clone();
    assert_eq!([&row["agent"], &row["attempts"]], [&json!("Secret Model"), &json!(2)]);
}

#[tokio::test]
async fn a_withdrawn_run_leaves_a_trace_that_still_counts() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = Service::start_as_told(&database, &[]);
    let (ours, theirs) = (key(&database, "us"), key(&database, "them"));
    service.use_key(Some(&ours));
    let configuration = json!({ "configuration_sha256": "b".repeat(64) });
    let mut runs = Vec::new();
    for unsolved in [0, 2, 20] {
        let body = json!({ "agent": "again", "suite": "mineceraft-lite", "card": configuration });
        let run = service.post_json("/v1/runs", &body).await.json()["id"].as_str().unwrap().to_owned();
        service.answer_run(&run, unsolved).await;
        runs.push(run);
    }
    let bad = runs[2].clone();
    let path = format!("/v1/runs/{bad}/withdraw");
    let reason = json!({ "reason": "the harness cut\nanswers off <b>" });
    assert_eq!(service.post_json(&path, &json!({ "reason": " " })).await.faults(422), ["null /reason"]);
    assert_eq!(service.post_json(&path, &json!({})).await.faults(422), ["null /reason"]);
    assert_eq!(service.post_json(&path, &json!(["a list"])).await.faults(422), ["null "]);
    let open = service.begin_run("again", "mineceraft-lite").await;
    let early = service.post_json(&format!("/v1/runs/{open}/withdraw"), &reason).await;
    assert_eq!(
        (early.status, early.json()["type"].as_str()),
        (StatusCode::CONFLICT, Some("urn:plumbline:problem:run-not-finished"))
    );
    service.use_key(Some(&theirs));
    assert_eq!(service.post_json(&path, &reason).await.status, StatusCode::FORBIDDEN);
    service.use_key(Some(&ours));
    let withdrawn = service.post_json(&path, &reason).await;
    assert_eq!(withdrawn.status, StatusCode::OK, "{}", withdrawn.text);
    assert_eq!(withdrawn.json()["withdrawn"]["reason"], reason["reason"]);
    let again = service.post_json(&path, &reason).await;
    assert_eq!(
        (again.status, again.json()["type"].as_str()),
        (StatusCode::CONFLICT, Some("urn:plumbline:problem:already-so"))
    );

    service.use_key(None);
    let board = service.get(BOARD).await.json();
    let listed: Vec<&str> = board["rows"].as_array().unwrap().iter().map(|row| row["run"].as_str().unwrap()).collect();
    assert_eq!(listed, [&runs[0], &runs[1]]);
    assert_eq!(board["rows"][0]["attempts"], 4, "withdrawing takes no attempt away");
    let trace = &board["withdrawn"][0];
    assert_eq!([&trace["run"], &trace["attempts"], &trace["reason"]], [&json!(bad), &json!(4), &reason["reason"]]);
    let group = service.get(&format!("{BOARD}/repeats")).await.json()["groups"][0].clone();
    assert_eq!((group["runs"].as_array().unwrap().len(), &group["withdrawn"]), (2, &json!(1)), "{group}");
    assert!(!service.get(&format!("/runs/{bad}")).await.text.contains("<dt>rank</dt>"));
    let page = service.get("/boards/mineceraft-lite").await.text;
    assert!(page.contains("Withdrawn runs") && page.contains("answers off &#60;b&#62;"), "{page}");
    assert!(service.get(&format!("/runs/{bad}")).await.text.contains("Withdrawn by its owner"));
    assert_eq!(service.get(&format!("{BOARD}?agent=nobody")).await.json().get("withdrawn"), None);

    // A run without an owner is nobody's to withdraw but the operator's.
    let mut open = Service::start(&folder.path().join("open.db"), &[]);
    let nobodys = open.finished_run("agent", 3).await;
    let refused = open.post_json(&format!("/v1/runs/{nobodys}/withdraw"), &reason).await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN, "{}", refused.text);
    let made = plumbline(&["keys", "create", "--name", "host", "--scopes", "admin"], &folder.path().join("open.db"));
    open.use_key(Some(&succeeded(&made)));
    let done = open.post_json(&format!("/v1/runs/{nobodys}/withdraw"), &reason).await;
    assert!(done.status.is_success(), "{}", done.text);
    assert!(open.get(&format!("/runs/{nobodys}")).await.text.contains("Withdrawn by the operator"));
    // Other sites add parameters to links, which a page passes over and the API refuses.
    for page in
        ["/boards/mineceraft-lite", "/boards/mineceraft-lite/charts", "/suites/mineceraft-lite/tasks", "/search"]
    {
        let followed = open.get(&format!("{page}?fbclid=x&utm_source=y")).await;
        assert_eq!(followed.status, StatusCode::OK, "{page}: {}", followed.text);
    }
    assert_eq!(open.get("/v1/leaderboards/mineceraft-lite?fbclid=x").await.status, StatusCode::BAD_REQUEST);
    let to_come = open.get("/boards/mineceraft-lite?as_of=9999-01-01").await.text;
    assert!(to_come.contains("That time has not passed"), "{to_come}");

    // An operator cannot bring it back.
    let admin = succeeded(&plumbline(&["keys", "create", "--name", "host", "--scopes", "admin"], &database));
    service.use_key(Some(&admin));
    let traces = async |service: &Service| service.get(BOARD).await.json().get("withdrawn").is_some();
    let act = |action: &str| json!({ "action": action, "reason": "r" });
    let path = format!("/v1/runs/{bad}/board-actions");
    assert_eq!(service.post_json(&path, &json!(["hide", "a list"])).await.faults(422), ["null "]);
    assert_eq!(service.post_json(&path, &act("restore")).await.status, StatusCode::CONFLICT);
    assert!(traces(&service).await);
    assert_eq!(service.post_json(&path, &act("hide")).await.status, StatusCode::OK);
    assert!(!traces(&service).await, "what the operator hid is hidden");
    assert_eq!(service.post_json(&path, &act("restore")).await.status, StatusCode::OK);
    assert_eq!(service.get(BOARD).await.json()["rows"].as_array().unwrap().len(), 2);
}
