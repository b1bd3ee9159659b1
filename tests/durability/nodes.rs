//! Several nodes on one PostgreSQL server: they die, freeze, lose the server, and the server dies; nothing that was
//! acknowledged is lost or graded twice, and the boards of all nodes agree.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use plumbline::store::db::{Pool, query_scalar};
use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::support::audit::audit_books;
use crate::support::cluster::Cluster;
use crate::support::commands::succeeded;
use crate::support::line::{Line, Passes};
use crate::support::{PROGRAM, Service, good_build};

const OWNERS: [&str; 5] = ["ada", "bea", "cem", "dov", "eve"];
/// Submissions of each owner that belong to no run.
const SUBMISSIONS: usize = 975;
/// Submissions of a body.
const AT_ONCE: usize = 75;

/// A server with a database, and the secrets that its nodes share.
struct Scene {
    cluster: Cluster,
    folder: tempfile::TempDir,
}

impl Scene {
    fn new() -> Self {
        let cluster = Cluster::start(&[]);
        cluster.create("grades");
        let scene = Self { cluster, folder: tempfile::tempdir().unwrap() };
        scene.run(&["migrate", "--create"]);
        scene
    }

    fn url(&self) -> String {
        self.cluster.url("grades")
    }

    fn command(&self, arguments: &[&str], url: &str) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments).args(["--database", url, "--secrets"]).arg(self.folder.path().join("secrets"));
        command
    }

    fn run(&self, arguments: &[&str]) -> String {
        succeeded(&self.command(arguments, &self.url()).output().unwrap())
    }

    fn node(&self, role: &str, url: &str) -> Service {
        Service::launch(self.command(&[role, "--lease-seconds", "2", "--workers", "1"], url))
    }

    async fn pool(&self) -> Pool {
        Pool::Postgres(sqlx::PgPool::connect(&self.url()).await.unwrap())
    }
}

/// Posts bodies of an owner to whichever node answers, and returns what was acknowledged.
async fn post_all(owner: usize, key: String, urls: Vec<String>, run: String) -> Vec<String> {
    let client = plumbline::client::without_tls().build().unwrap();
    let lite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
    let runs: Vec<String> = lite.tasks.iter().map(|task| good_build(task, owner > 2, Some(&run)).to_string()).collect();
    let alone: Vec<String> = (0..SUBMISSIONS)
        .map(|i| {
            let rows = json!([[i, 0, owner, 0], [i, 1, owner, 0]]);
            json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": rows }] }).to_string()
        })
        .collect();
    let mut acknowledged = Vec::new();
    for (i, body) in std::iter::once(runs.as_slice()).chain(alone.chunks(AT_ONCE)).enumerate() {
        let once = format!("{owner}-{i}");
        let begun = Instant::now();
        let mut node = i;
        loop {
            assert!(begun.elapsed() < Duration::from_mins(2), "no node takes the body {once}");
            let request = client
                .post(format!("{}/v1/submissions", urls[node % urls.len()]))
                .header("content-type", "application/x-ndjson")
                .header("idempotency-key", &once)
                .timeout(Duration::from_secs(20))
                .bearer_auth(&key)
                .body(body.join("\n"));
            node += 1;
            let Ok(answer) = request.send().await else { continue };
            let (status, text) = (answer.status(), answer.text().await.unwrap_or_default());
            if status == StatusCode::ACCEPTED {
                let Ok(told) = serde_json::from_str::<Value>(&text) else { continue };
                let all = told["submissions"].as_array().unwrap();
                acknowledged.extend(all.iter().map(|one| one["id"].as_str().unwrap().to_owned()));
                // Posting goes on until after the last failure.
                tokio::time::sleep(Duration::from_millis(900)).await;
                break;
            }
            assert!(status.is_server_error() || status == StatusCode::CONFLICT, "{status} {text}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
    acknowledged
}

async fn left(pool: &Pool) -> i64 {
    query_scalar("SELECT COUNT(*) FROM submissions WHERE ended_at_ms IS NULL").fetch_one(pool).await.unwrap_or(-1)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_die_freeze_and_lose_the_server_and_nothing_is_lost() {
    let scene = Scene::new();
    let line = Line::to(scene.cluster.port).await;
    let through_line = scene.url().replace(&format!(":{}/", scene.cluster.port), &format!(":{}/", line.port));
    // One that stays, one that freezes, one whose line is cut, and workers that die.
    let stays = scene.node("serve", &scene.url());
    let freezes = scene.node("serve", &scene.url());
    let cut_off = scene.node("serve", &through_line);
    let mut dying = scene.node("work", &scene.url());
    let urls = [&stays, &freezes, &cut_off].map(|node| node.url.clone()).to_vec();

    let mut posting = Vec::new();
    for (i, owner) in OWNERS.into_iter().enumerate() {
        let key = scene.run(&["keys", "create", "--name", owner]);
        let begin = json!({ "agent": format!("agent of {owner}"), "suite": "mineceraft-lite" });
        let begun = stays.send(stays.http.post(format!("{}/v1/runs", stays.url)).bearer_auth(&key).json(&begin)).await;
        let run = begun.json()["id"].as_str().unwrap().to_owned();
        posting.push(tokio::spawn(post_all(i, key, urls.clone(), run)));
    }
    let pool = scene.pool().await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    for _ in 0..3 {
        dying.kill();
        dying = scene.node("work", &scene.url());
        tokio::time::sleep(Duration::from_millis(700)).await;
    }
    freezes.signal("STOP");
    line.set(Passes::Cut);
    tokio::time::sleep(Duration::from_secs(4)).await;
    freezes.signal("CONT");
    scene.cluster.restart_hard(Duration::from_secs(1));
    let restarted = Instant::now();
    dying.kill();
    let worker = scene.node("work", &scene.url());
    stays.wait_for("/readyz", |ready| ready["status"] == "ok").await;
    eprintln!("ready again {:?} after the server came back", restarted.elapsed());
    while left(&pool).await < 0 {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let mut acknowledged = Vec::new();
    for posting in posting {
        acknowledged.extend(posting.await.unwrap());
    }
    assert_eq!(acknowledged.len(), OWNERS.len() * (SUBMISSIONS + 25));
    let begun = Instant::now();
    while left(&pool).await != 0 {
        assert!(begun.elapsed() < Duration::from_mins(3), "{} submissions are stuck", left(&pool).await);
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    eprintln!("the last were graded {:?} after they were posted", begun.elapsed());

    // All nodes that reach the server show the same board within a second.
    tokio::time::sleep(Duration::from_secs(1)).await;
    let board = async |node: &Service| node.get("/v1/leaderboards/mineceraft-lite").await.json()["rows"].clone();
    let (one, other) = (board(&stays).await, board(&freezes).await);
    assert_eq!(one.as_array().unwrap().len(), OWNERS.len(), "{one}");
    assert_eq!(one, other);
    assert!(worker.get("/readyz").await.status.is_success());
    assert_eq!(worker.get("/v1/runs").await.status, StatusCode::NOT_FOUND);
    for node in [stays, freezes, worker] {
        assert!(node.terminate());
    }
    drop(cut_off);
    audit_books(&pool, &acknowledged, "nodes").await;
}

/// What a frozen or slow transaction of another node must not do: let a reader that remembers the last event pass over
/// one that is committed later.
#[tokio::test]
async fn events_become_visible_in_the_order_of_their_numbers() {
    let scene = Scene::new();
    let node = Service::launch(scene.command(&["serve", "--open"], &scene.url()));
    let body = |x: u32| json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] });
    let first = node.post_json("/v1/submissions", &body(0)).await.json()["id"].as_str().unwrap().to_owned();
    node.wait_for(&format!("/v1/submissions/{first}"), |one| one["state"] == "graded").await;
    let pool = sqlx::PgPool::connect(&scene.url()).await.unwrap();
    let last = || async { sqlx::query_scalar::<_, i64>("SELECT MAX(id) FROM events").fetch_one(&pool).await.unwrap() };
    let before = last().await;

    // Another node is about to tell an end: it holds the lock and has taken a number, but is not done.
    let mut slow = pool.begin().await.unwrap();
    sqlx::query("SELECT pg_advisory_xact_lock(hashtextextended('order', 0))").execute(&mut *slow).await.unwrap();
    let told = "INSERT INTO events (at_ms, submission_id, state) VALUES (0, $1, 'graded') RETURNING id";
    let taken: i64 = sqlx::query_scalar(told).bind(&first).fetch_one(&mut *slow).await.unwrap();
    let second = node.post_json("/v1/submissions", &body(1)).await.json()["id"].as_str().unwrap().to_owned();
    tokio::time::sleep(Duration::from_millis(500)).await;
    // The node's own end waits, so that no greater number becomes visible before the smaller one.
    assert_eq!(last().await, before);
    slow.commit().await.unwrap();
    node.wait_for(&format!("/v1/submissions/{second}"), |one| one["state"] == "graded").await;
    let after: Vec<(i64, String)> = sqlx::query_as("SELECT id, submission_id FROM events WHERE id > $1 ORDER BY id")
        .bind(before)
        .fetch_all(&pool)
        .await
        .unwrap();
    assert_eq!(after.iter().map(|(_, id)| id).collect::<Vec<_>>(), [&first, &second]);
    assert_eq!(after[0].0, taken);
}

/// Owners take turns over all nodes: whoever comes late does not wait for the thousand submissions of another.
#[tokio::test]
async fn owners_take_turns_over_all_nodes() {
    let scene = Scene::new();
    // Nobody grades while both post, each to a node of its own.
    let nodes = [(); 2].map(|()| Service::launch(scene.command(&["serve", "--open", "--workers", "0"], &scene.url())));
    let [many, one] = ["many", "one"].map(|owner| scene.run(&["keys", "create", "--name", owner]));
    let line = |i: usize| json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[i, 0, 0, 0]] }] }).to_string();
    let post = |node: usize, key: String, lines: Vec<String>| {
        let (client, url) = (&nodes[node].http, format!("{}/v1/submissions", nodes[node].url));
        let request = client.post(url).header("content-type", "application/x-ndjson").bearer_auth(key);
        nodes[node].send(request.body(lines.join("\n")))
    };
    assert_eq!(post(0, many, (0..500).map(line).collect()).await.status, StatusCode::ACCEPTED);
    let late = post(1, one, vec![line(0)]).await.json()["submissions"][0]["id"].as_str().unwrap().to_owned();
    let waiting = nodes[0].get(&format!("/v1/submissions/{late}")).await.json();
    assert!(waiting["queued_before"].as_i64().is_some_and(|before| before <= 1), "{waiting}");
    let worker = scene.node("work", &scene.url());
    worker.wait_for("/readyz", |ready| ready["status"] == "ok").await;
    nodes[0].wait_for(&format!("/v1/submissions/{late}"), |one| one["state"] == "graded").await;
}

#[test]
fn the_folder_of_this_test_is_removed_with_its_server() {
    let cluster = Cluster::start(&[]);
    let data = cluster.data.clone();
    assert!(Path::new(&data).exists());
    drop(cluster);
    assert!(!Path::new(&data).exists());
}
