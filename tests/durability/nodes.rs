//! Several nodes on one PostgreSQL server: they die, freeze, lose the server, and the server dies; nothing that was
//! acknowledged is lost or graded twice, and the boards of all nodes agree.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use plumbline::store::db::{Pool, query_scalar};
use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::support::audit::audit_books;
use crate::support::cluster::Cluster;
use crate::support::line::{Line, Passes};
use crate::support::nodes::Nodes;
use crate::support::{Service, good_build};

const OWNERS: [&str; 5] = ["ada", "bea", "cem", "dov", "eve"];
/// Submissions of each owner that belong to no run.
const SUBMISSIONS: usize = 975;
/// Submissions of a body.
const AT_ONCE: usize = 75;

/// Posts bodies of an owner to whichever node answers, and returns what was acknowledged.
async fn post_all(owner: usize, key: String, urls: Arc<Mutex<Vec<String>>>, run: String) -> Vec<String> {
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
            let url = {
                let urls = urls.lock().unwrap();
                urls[node % urls.len()].clone()
            };
            let request = client
                .post(format!("{url}/v1/submissions"))
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
    let scene = Nodes::new();
    let line = Line::to(scene.cluster.port).await;
    let through_line = scene.url().replace(&format!(":{}/", scene.cluster.port), &format!(":{}/", line.port));
    let node =
        |role: &str, url: &str| Service::launch(scene.command(&[role, "--lease-seconds", "2", "--workers", "1"], url));
    // One that stays, one that freezes, one whose line is cut, and two that are killed again and again.
    let stays = node("serve", &scene.url());
    let freezes = node("serve", &scene.url());
    let cut_off = node("serve", &through_line);
    let mut dying = ["serve", "work"].map(|role| node(role, &scene.url()));
    let urls = [&stays, &freezes, &cut_off, &dying[0]].map(|node| node.url.clone()).to_vec();
    let urls = Arc::new(Mutex::new(urls));

    let mut posting = Vec::new();
    for (i, owner) in OWNERS.into_iter().enumerate() {
        let key = scene.key(owner);
        let begin = json!({ "agent": format!("agent of {owner}"), "suite": "mineceraft-lite" });
        let begun = stays.send(stays.http.post(format!("{}/v1/runs", stays.url)).bearer_auth(&key).json(&begin)).await;
        let run = begun.json()["id"].as_str().unwrap().to_owned();
        posting.push(tokio::spawn(post_all(i, key, Arc::clone(&urls), run)));
    }
    let pool = scene.pool().await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    let seed: u64 = std::env::var("PLUMBLINE_NODES_SEED").map_or(18, |seed| seed.parse().unwrap());
    let mut chance = rand_mt::Mt64::from(seed);
    for kill in 0..6 {
        // Both die at least once, whatever the chance.
        let victim = if kill < 2 { kill } else { (chance.next_u64() % 2) as usize };
        let role = ["serve", "work"][victim];
        std::mem::replace(&mut dying[victim], node(role, &scene.url())).kill();
        urls.lock().unwrap()[3].clone_from(&dying[0].url);
        tokio::time::sleep(Duration::from_millis(100 + chance.next_u64() % 600)).await;
    }
    freezes.signal("STOP");
    line.set(Passes::Cut);
    tokio::time::sleep(Duration::from_secs(4)).await;
    freezes.signal("CONT");
    scene.cluster.restart_hard(Duration::from_secs(1));
    let restarted = Instant::now();
    line.set(Passes::All);
    for node in [&stays, &freezes, &cut_off] {
        node.wait_for("/readyz", |ready| ready["status"] == "ok").await;
    }
    eprintln!("seed {seed}: all nodes are ready {:?} after the server came back", restarted.elapsed());
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

    let stored: i64 = query_scalar("SELECT COUNT(*) FROM submissions").fetch_one(&pool).await.unwrap();
    assert_eq!(stored as usize, acknowledged.len(), "a body that was sent again is stored once");

    // All nodes show the same board within a second.
    tokio::time::sleep(Duration::from_secs(1)).await;
    let [serves, works] = dying;
    let mut boards = Vec::new();
    for node in [&stays, &freezes, &cut_off, &serves] {
        boards.push(node.get("/v1/leaderboards/mineceraft-lite").await.json()["rows"].clone());
    }
    assert_eq!(boards[0].as_array().unwrap().len(), OWNERS.len(), "{}", boards[0]);
    assert!(boards.iter().all(|board| *board == boards[0]), "{boards:#?}");
    assert!(works.get("/readyz").await.status.is_success());
    assert_eq!(works.get("/v1/runs").await.status, StatusCode::NOT_FOUND);
    for node in [stays, freezes, cut_off, serves, works] {
        assert!(node.terminate());
    }
    audit_books(&pool, &acknowledged, "nodes").await;
}

#[test]
fn the_folder_of_this_test_is_removed_with_its_server() {
    let cluster = Cluster::start(&[]);
    let data = cluster.data.clone();
    assert!(Path::new(&data).exists());
    drop(cluster);
    assert!(!Path::new(&data).exists());
}
