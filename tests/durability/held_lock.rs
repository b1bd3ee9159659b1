//! Another process holds the write lock for 20 s: every GET and `/v1/validate` answer all the same, also for a key's
//! first use.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sqlx::ConnectOptions as _;

use crate::support::commands::{plumbline, succeeded};
use crate::support::epoch::{Scene, id};
use crate::support::pages::must_be_asked_for;

/// How long the lock is held.
const HELD: Duration = Duration::from_secs(20);
/// How long an answer may take meanwhile. What waits for the lock ends before as an error, after ten seconds.
const PROMPT: Duration = Duration::from_secs(15);

/// A value for each parameter of a path that GETs have.
fn filled(path: &str, ids: &Value) -> String {
    let with_id = |kind: &str| path.replace("{id}", ids[kind].as_str().unwrap());
    let path = match path.split('/').nth(2).unwrap_or_default() {
        "entries" => with_id("entry"),
        "instances" => with_id("instance"),
        "episodes" => with_id("episode"),
        "runs" => with_id("run"),
        "submissions" => with_id("submission"),
        "webhooks" => with_id("webhook"),
        _ => path.to_owned(),
    };
    let path = path.replace("{epoch}", "autumn").replace("{suite}", "mineceraft");
    let path = path.replace("{family}/{instance}", "walls/5x1x5-raise");
    assert!(!path.contains('{'), "{path}: give its parameters values");
    if path.ends_with("/view") {
        return format!("{path}?from=0,0,0&to=1,1,1");
    }
    if path.ends_with("/compare") { format!("{path}?a={0}&b={0}", ids["run"].as_str().unwrap()) } else { path }
}

/// Every page, and what other tools read of the log.
fn pages(run: &str, submission: &str) -> Vec<String> {
    vec![
        "/".to_owned(),
        "/boards/mineceraft".to_owned(),
        "/epochs".to_owned(),
        "/epochs/autumn".to_owned(),
        "/suites/mineceraft/tasks".to_owned(),
        format!("/runs/{}", run),
        format!("/submissions/{}", submission),
        format!("/submissions/{}/view.svg", submission),
        format!("/submissions/{}/thumbnail.png", submission),
        "/suites/mineceraft/tasks/113/thumbnail.png".to_owned(),
        "/suites/mineceraft/tasks/113/preview.png".to_owned(),
        "/suites/mineceraft/tasks/113/view.svg".to_owned(),
        "/suites/mineceraft/tasks/113/reference.json".to_owned(),
        "/suites/mineceraft/tasks/113".to_owned(),
        "/about".to_owned(),
        "/boards/mineceraft/charts".to_owned(),
        "/boards/mineceraft/charts/intervals.svg".to_owned(),
        "/boards/mineceraft/log".to_owned(),
        format!("/boards/mineceraft/compare?a={0}&b={0}", run),
        format!("/boards/mineceraft/compare.svg?a={0}&b={0}", run),
        format!("/boards/mineceraft/compare.csv?a={0}&b={0}", run),
        format!("/runs/{}/tasks/113", run),
        format!("/runs/{}/tasks/113/thumbnail.png", run),
        format!("/runs/{}/tasks/113/preview.png", run),
        format!("/submissions/{}/preview.png", submission),
        format!("/submissions/{}/evidence.html", submission),
        format!("/compare?a={0}&b={0}", submission),
        "/agents/a".to_owned(),
        "/search?text=a".to_owned(),
        "/moderation".to_owned(),
        "/docs/".to_owned(),
        "/log/checkpoint".to_owned(),
        "/log/key".to_owned(),
        "/log/witnesses".to_owned(),
    ]
}

#[tokio::test]
async fn reads_never_wait_for_the_writer() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let scene = Scene::new(&[]);
    let key = scene.key("lab");
    let entry = scene.register(&key, "dev", 1).await;
    let instances = scene.draw(&key, &entry, 1).await;
    let run = scene.made(&key, "/v1/runs", &json!({ "agent": "a", "suite": "mineceraft" })).await;
    let turns = json!([{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }]);
    let body = json!({ "run": run["id"], "task": 113, "turns": turns });
    let submission = scene.made(&key, "/v1/submissions", &body).await;
    let episode = scene.made(&key, "/v1/episodes", &json!({ "task": 113 })).await;
    let webhook = scene.made(&key, "/v1/webhooks", &json!({ "url": "https://lab.example/" })).await;
    let ids = json!({
        "episode": episode["id"], "entry": entry, "instance": id(&instances[0]), "run": run["id"], "submission": submission["id"],
        "webhook": webhook["id"],
    });
    for of in [format!("/v1/runs/{}", id(&run)), format!("/v1/entries/{entry}")] {
        let card = scene.service.http.put(format!("{}{of}/card", scene.service.url)).bearer_auth(&key);
        assert!(scene.service.send(card.json(&json!({ "agent_version": "1" }))).await.status.is_success());
    }
    let waiting = format!("/v1/submissions/{}", id(&submission));
    scene.service.wait_for(&waiting, |submission| submission["state"] == "graded").await;
    let finish = format!("/v1/runs/{}/finish", id(&run));
    scene.made(&key, &finish, &json!({ "skip": "unanswered" })).await;
    scene.service.wait_for(&format!("/v1/runs/{}", id(&run)), |run| run["state"] == "finished").await;
    let document = scene.service.get("/openapi.json").await.json();
    let unused = scene.key("lab");
    // A process makes the list once, which takes seconds and reads no database.
    assert!(scene.service.get("/v1/siblings").await.status.is_success());

    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(scene.file("p.db"));
    let mut holder = options.connect().await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut holder).await.unwrap();
    let held = Instant::now();
    let pages = pages(id(&run), id(&submission));
    must_be_asked_for(&pages, |_| true);
    let gets = document["paths"].as_object().unwrap().iter().filter(|(_, item)| item["get"].is_object());
    let paths: Vec<String> = gets.map(|(path, _)| filled(path, &ids)).chain(pages).collect();
    while held.elapsed() < HELD {
        // From the second round on the epoch is over by the clock, and cannot be sealed.
        for path in &paths {
            let begun = Instant::now();
            let request = scene.service.http.get(format!("{}{path}", scene.service.url)).bearer_auth(&unused);
            let response = tokio::time::timeout(PROMPT, request.send()).await;
            let response = response.unwrap_or_else(|_| panic!("{path} waits")).unwrap();
            let (status, took) = (response.status().as_u16(), begun.elapsed());
            // The one that says whether the database can be written says that it cannot.
            let expected: &[u16] = match path.as_str() {
                "/readyz" => &[200, 503],
                // Nothing is revealed before the epoch is sealed.
                path if path.ends_with("/reveal") || path.ends_with("/answers") => &[409],
                path if path.starts_with("/v1/instances/") && path.ends_with("/report") => &[409],
                // Its receipt is published with its grade, and there is no answer.
                path if path.starts_with("/v1/instances/") && path.ends_with("/receipt") => &[404],
                _ => &[200],
            };
            assert!(expected.contains(&status), "{path}: {status} after {took:?}");
        }
        let begun = Instant::now();
        let again = json!({ "run": null, "suite": null, "task": 113, "turns": turns });
        let valid = scene.post(&unused, "/v1/validate", &again).await;
        assert!(valid.status.is_success() && begun.elapsed() < PROMPT, "{}", valid.text);
        scene.set_clock(7_200_000);
    }
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await;
    assert_eq!(reveal.status, 409, "it is not sealed: {}", reveal.text);
    sqlx::query("ROLLBACK").execute(&mut holder).await.unwrap();
    let epoch = "/v1/epochs/autumn/leaderboard";
    scene.service.wait_for(epoch, |board| board["is_released"] == true).await;
    // The first use of the key was noted while the lock was held, and is stored once it is free.
    let id = unused.split('_').nth(1).unwrap();
    let is_stored = || {
        let listed = succeeded(&plumbline(&["keys", "list"], &scene.file("p.db")));
        listed.lines().any(|line| line.contains(id) && !line.contains("never"))
    };
    for _ in 0..200 {
        if is_stored() {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("the use of the key was not stored");
}
