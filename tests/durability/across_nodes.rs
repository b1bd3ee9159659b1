//! What holds across the nodes of one PostgreSQL database: order, turns, limits, what only one may do, and who finds
//! work without notices.

use std::process::Command;
use std::time::Duration;

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use sqlx::{Executor as _, Row as _};

use crate::support::epoch::{CONFIGURATION, answer_to, id, pool_of};
use crate::support::nodes::Nodes;
use crate::support::{Answer, Service};

fn block(x: usize) -> Value {
    json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] })
}

async fn ask(node: &Service, method: Method, path: &str, key: &str, body: &Value) -> Answer {
    let request = node.http.request(method, format!("{}{path}", node.url)).bearer_auth(key);
    node.send(request.json(body)).await
}

async fn post(node: &Service, path: &str, key: &str, body: &Value) -> Answer {
    ask(node, Method::POST, path, key, body).await
}

/// Posts the same to all nodes at once, so many times to each.
async fn race(nodes: &[Service], path: &str, key: &str, body: &Value, times: usize) -> Vec<Answer> {
    let each = (0..times).flat_map(|_| nodes).map(|node| post(node, path, key, body));
    futures_util::future::join_all(each).await
}

/// Counts answers by status.
fn count(answers: &[Answer], status: StatusCode) -> usize {
    answers.iter().filter(|answer| answer.status == status).count()
}

/// A reader that goes on after the last number it saw must not pass over a row that is committed later.
#[tokio::test]
async fn numbers_become_visible_in_their_order() {
    const NEXT: &str = "INSERT INTO events (at_ms, submission_id, state) VALUES (0, $1, 'graded') RETURNING id";
    let scene = Nodes::new();
    let node = scene.start(&["serve", "--open"]);
    let accepted =
        async |x: usize| node.post_json("/v1/submissions", &block(x)).await.json()["id"].as_str().unwrap().to_owned();
    let first = accepted(0).await;
    node.wait_for(&format!("/v1/submissions/{first}"), |one| one["state"] == "graded").await;
    let pool = scene.connect().await;
    let seen = async |after: i64| -> Vec<(i64, String)> {
        let select = "SELECT id, submission_id FROM events WHERE id > $1 ORDER BY id";
        sqlx::query_as(select).bind(after).fetch_all(&pool).await.unwrap()
    };
    let last = async || seen(0).await.last().unwrap().0;

    // Without the lock a reader loses a row: the second number is seen first, and the reader goes on from there.
    let (mut slow, mut quick) = (pool.begin().await.unwrap(), pool.begin().await.unwrap());
    let lost: i64 = sqlx::query_scalar(NEXT).bind(&first).fetch_one(&mut *slow).await.unwrap();
    sqlx::query(NEXT).bind(&first).execute(&mut *quick).await.unwrap();
    quick.commit().await.unwrap();
    let reads_on_from = last().await;
    slow.commit().await.unwrap();
    assert!(reads_on_from > lost && seen(reads_on_from).await.is_empty(), "this is what the lock is for");

    // Another node is about to tell an end: it holds the lock and has taken a number, but is not done.
    let before = last().await;
    let mut slow = pool.begin().await.unwrap();
    slow.execute("SELECT pg_advisory_xact_lock(hashtextextended('order', 0))").await.unwrap();
    let taken: i64 = sqlx::query_scalar(NEXT).bind(&first).fetch_one(&mut *slow).await.unwrap();
    let second = accepted(1).await;
    let new_run = json!({ "agent": "late", "suite": "mineceraft-lite" });
    let new_run = node.post_json("/v1/runs", &new_run);
    let released = async {
        // The node asks for the lock at least twice: for the end of the submission, and for the run.
        let both_wait = async {
            while waiting_for_locks(&pool).await < 2 {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        tokio::time::timeout(Duration::from_mins(1), both_wait).await.expect("both wait for the lock");
        assert_eq!(last().await, before, "an end with a greater number waits");
        for table in ["results", "receipts", "runs"] {
            let rows: i64 = sqlx::query_scalar(sqlx::AssertSqlSafe(format!("SELECT COUNT(*) FROM {table}")))
                .fetch_one(&pool)
                .await
                .unwrap();
            let before_all = i64::from(table == "receipts");
            assert_eq!(rows, before_all, "{table} has rows before the lock is free");
        }
        slow.commit().await.unwrap();
    };
    let (begun, ()) = tokio::join!(new_run, released);
    assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.text);
    node.wait_for(&format!("/v1/submissions/{second}"), |one| one["state"] == "graded").await;
    let after = seen(before).await;
    assert_eq!(after.iter().map(|(_, id)| id).collect::<Vec<_>>(), [&first, &second]);
    assert_eq!(after[0].0, taken);
}

/// Counts the sessions that wait for an advisory lock.
async fn waiting_for_locks(pool: &sqlx::PgPool) -> i64 {
    const WAITING: &str = "SELECT COUNT(*) FROM pg_locks WHERE locktype = 'advisory' AND NOT granted";
    sqlx::query_scalar(WAITING).fetch_one(pool).await.unwrap()
}

/// Owners take turns over all nodes: whoever comes late does not wait for the five hundred submissions of another.
#[tokio::test]
async fn owners_take_turns_over_all_nodes() {
    let scene = Nodes::new();
    // Nobody grades while both post, each to a node of its own.
    let nodes = [(); 2].map(|()| scene.start(&["serve", "--open", "--workers", "0"]));
    let [many, one] = ["many", "one"].map(|owner| scene.key(owner));
    let lines: Vec<String> = (0..500).map(|x| block(x).to_string()).collect();
    let request = nodes[0].http.post(format!("{}/v1/submissions", nodes[0].url)).bearer_auth(many);
    let posted = nodes[0].send(request.header("content-type", "application/x-ndjson").body(lines.join("\n"))).await;
    assert_eq!(posted.status, StatusCode::ACCEPTED);
    let late = post(&nodes[1], "/v1/submissions", &one, &block(0)).await.json()["id"].as_str().unwrap().to_owned();
    let waiting = nodes[0].get(&format!("/v1/submissions/{late}")).await.json();
    assert!(waiting["queued_before"].as_i64().is_some_and(|before| before <= 1), "{waiting}");
    let _worker = scene.start(&["work", "--workers", "1"]);
    nodes[0].wait_for(&format!("/v1/submissions/{late}"), |one| one["state"] == "graded").await;
    let ended_before: i64 = sqlx::query_scalar(
        "SELECT COUNT(*) FROM events WHERE id < (SELECT MIN(id) FROM events WHERE submission_id = $1)",
    )
    .bind(&late)
    .fetch_one(&scene.connect().await)
    .await
    .unwrap();
    // It is the second in line, so it is among the 64 that are claimed first; the node's other worker may be quicker with
    // its own.
    assert!(ended_before < 250, "{ended_before} of the other owner were graded before it");
}

/// Two nodes on a database with an epoch of hidden evaluation, and one that grades nothing.
fn with_an_epoch(workers: &str) -> (Nodes, Vec<Service>) {
    let scene = Nodes::new();
    let closes = (jiff::Timestamp::now() + jiff::SignedDuration::from_hours(1)).to_string();
    scene.run(&[
        "epochs",
        "create",
        "autumn",
        "--closes",
        &closes,
        "--per-instance",
        "3",
        "--owner-percent",
        "100",
        "--no-siblings",
    ]);
    let nodes = (0..2).map(|_| scene.start(&["serve", "--workers", workers])).collect();
    (scene, nodes)
}

async fn drawn(node: &Service, key: &str, configuration: &str) -> Vec<Value> {
    let new = json!({ "agent": "a", "configuration_sha256": configuration, "tier": "official", "runs": 1 });
    let entry = post(node, "/v1/epochs/autumn/entries", key, &new).await;
    assert_eq!(entry.status, StatusCode::CREATED, "{}", entry.text);
    let draw = json!({ "run": 1, "nonce": "a nonce of our own" });
    let drawn = post(node, &format!("/v1/entries/{}/instances", id(&entry.json())), key, &draw).await;
    drawn.json()["instances"].as_array().unwrap_or_else(|| panic!("{}", drawn.text)).clone()
}

/// The same holds for answers to hidden instances, whose queue nobody sees.
#[tokio::test]
async fn hidden_answers_take_turns_over_all_nodes() {
    let (scene, nodes) = with_an_epoch("0");
    let pool = pool_of(&scene.folder.path().join("secrets/epoch-autumn.json"));
    let [many, one] = ["many", "one"].map(|owner| scene.key(owner));
    let other = CONFIGURATION.replace('9', "8");
    let of_many = drawn(&nodes[0], &many, CONFIGURATION).await;
    let of_one = drawn(&nodes[1], &one, &other).await;
    let answer = async |node: &Service, key: &str, instance: &Value, pool: &_| {
        let path = format!("/v1/instances/{}/answer", id(instance));
        let taken = post(node, &path, key, &answer_to(instance, pool, false)).await;
        assert!(taken.status.is_success(), "{}", taken.text);
    };
    for instance in &of_many {
        answer(&nodes[0], &many, instance, &pool).await;
    }
    answer(&nodes[1], &one, &of_one[0], &pool).await;
    let turns: Vec<i64> = sqlx::query_scalar("SELECT turn FROM jobs WHERE owner = $1 ORDER BY turn")
        .bind("many")
        .fetch_all(&scene.connect().await)
        .await
        .unwrap();
    let late: i64 = sqlx::query_scalar("SELECT turn FROM jobs WHERE owner = 'one'")
        .fetch_one(&scene.connect().await)
        .await
        .unwrap();
    assert!(of_many.len() > 8 && turns.len() == of_many.len());
    assert!(late <= turns[1], "the only answer of an owner has turn {late} beside {turns:?}");
}

/// What is checked and then written stays right when two nodes do it at the same time.
#[tokio::test]
async fn limits_hold_when_two_nodes_are_asked_at_once() {
    let (scene, nodes) = with_an_epoch("1");
    let key = scene.key("lab");
    // A quota of ten.
    scene.run(&["quota", "grant", "--name", "lab", "--submissions", "10", "--reason", "a trial"]);
    let posted = race(&nodes, "/v1/submissions", &key, &block(0), 15).await;
    assert_eq!((count(&posted, StatusCode::ACCEPTED), posted.len()), (10, 30));
    assert!(posted.iter().all(|one| one.status == StatusCode::ACCEPTED || one.text.contains("quota-used-up")));
    scene.run(&["quota", "grant", "--name", "lab", "--submissions", "1000", "--reason", "more"]);
    // One submission for an idempotency key.
    let same = (0..20).map(|i| {
        let node = &nodes[i % 2];
        let request = node.http.post(format!("{}/v1/submissions", node.url)).bearer_auth(&key);
        node.send(request.header("idempotency-key", "once").json(&block(1)))
    });
    let same = futures_util::future::join_all(same).await;
    let ids: std::collections::BTreeSet<String> = same
        .iter()
        .filter(|one| one.status == StatusCode::ACCEPTED)
        .map(|one| one.json()["id"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(ids.len(), 1, "{same:?}");
    assert!(same.iter().all(|one| [StatusCode::ACCEPTED, StatusCode::CONFLICT].contains(&one.status)), "{same:?}");
    // Two live keys of a member.
    let member = ask(&nodes[0], Method::PUT, "/v1/team/members/ana", &key, &json!({ "role": "submitter" })).await;
    assert!(member.status.is_success(), "{}", member.text);
    let keys = race(&nodes, "/v1/team/members/ana/keys", &key, &json!({}), 5).await;
    assert_eq!(count(&keys, StatusCode::CREATED), 2, "{keys:?}");
    // As many entries as the pool has runs for.
    let new = json!({ "agent": "a", "configuration_sha256": CONFIGURATION, "tier": "official", "runs": 1 });
    let entries = race(&nodes, "/v1/epochs/autumn/entries", &key, &new, 5).await;
    assert_eq!(count(&entries, StatusCode::CREATED), 3, "{entries:?}");
    assert!(entries.iter().all(|one| one.status == StatusCode::CREATED || one.status == StatusCode::CONFLICT));
    let entry = entries.iter().find(|one| one.status == StatusCode::CREATED).unwrap().json();
    // One draw of a run, which all that ask get.
    let draw = json!({ "run": 1, "nonce": "a nonce of our own" });
    let draws = race(&nodes, &format!("/v1/entries/{}/instances", id(&entry)), &key, &draw, 5).await;
    let drawn: Vec<Value> = draws.iter().map(|one| one.json()["instances"].clone()).collect();
    assert!(drawn[0].is_array() && drawn.iter().all(|one| *one == drawn[0]), "{draws:?}");
    // One answer to an instance.
    let pool = pool_of(&scene.folder.path().join("secrets/epoch-autumn.json"));
    let answer = answer_to(&drawn[0][0], &pool, false);
    let answers = race(&nodes, &format!("/v1/instances/{}/answer", id(&drawn[0][0])), &key, &answer, 5).await;
    let first = answers.iter().filter(|one| one.status.is_success() && one.json()["repeated"] == false).count();
    assert_eq!(first, 1, "{answers:?}");
    assert!(answers.iter().all(|one| one.status.is_success()), "{answers:?}");
}

/// An example starts all of its nodes at once, on an empty database.
#[tokio::test]
async fn nodes_may_all_be_the_first() {
    let scene = Nodes::without_tables();
    let nodes: Vec<Service> = std::thread::scope(|scope| {
        let starting: Vec<_> = (0..3)
            .map(|_| scope.spawn(|| scene.start(&["serve", "--open", "--workers", "0"])))
            .chain((0..2).map(|_| scope.spawn(|| scene.start(&["work", "--workers", "1"]))))
            .collect();
        starting.into_iter().map(|node| node.join().unwrap()).collect()
    });
    let id = nodes[0].post_json("/v1/submissions", &block(0)).await.json()["id"].as_str().unwrap().to_owned();
    nodes[2].wait_for(&format!("/v1/submissions/{id}"), |one| one["state"] == "graded").await;
    let key = "/.well-known/plumbline-receipts.json";
    assert_eq!(nodes[0].get(key).await.text, nodes[1].get(key).await.text);
    // What one grants, all know: they share the log of receipts.
    let receipts = nodes[1].get("/v1/receipts").await.json();
    assert_eq!(receipts["receipts"].as_array().unwrap().len(), 1, "{receipts}");
}

/// A pooler that shares sessions passes no notices on.
#[tokio::test]
async fn without_notices_nodes_find_work_and_boards_agree() {
    let scene = Nodes::new();
    let [serves, other] = [(); 2].map(|()| scene.start(&["serve", "--open", "--no-notices", "--workers", "0"]));
    let mut worker: Command = scene.command(&["work", "--workers", "1"], &scene.url());
    let _worker = Service::launch({
        worker.env("PLUMBLINE_NO_NOTICES", "1");
        worker
    });
    let run = serves.finished_run("alone", 2).await;
    let listening: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM pg_stat_activity WHERE query ILIKE 'LISTEN%'")
        .fetch_one(&scene.connect().await)
        .await
        .unwrap();
    assert_eq!(listening, 0, "nobody listens");
    tokio::time::sleep(Duration::from_secs(1)).await;
    let [own, theirs] = [&serves, &other].map(|node| node.get("/v1/leaderboards/mineceraft-lite"));
    let (own, theirs) = tokio::join!(own, theirs);
    assert_eq!(own.json()["rows"][0]["run"], run.as_str(), "{}", own.text);
    assert_eq!(own.json()["rows"], theirs.json()["rows"]);
}

/// Notices come again when the server does.
#[tokio::test]
async fn nodes_listen_again_after_the_server_was_away() {
    let scene = Nodes::new();
    let _nodes = [scene.start(&["serve"]), scene.start(&["work"])];
    // The only statement that such a session ever sends.
    let listeners = async || -> i64 {
        let Ok(pool) = sqlx::PgPool::connect(&scene.url()).await else { return -1 };
        let count = "SELECT COUNT(*) FROM pg_stat_activity WHERE query ILIKE 'LISTEN%'";
        sqlx::query_scalar(count).fetch_one(&pool).await.unwrap_or(-1)
    };
    let all_listen = async || {
        while listeners().await != 2 {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::time::timeout(Duration::from_mins(1), all_listen()).await.expect("both nodes listen");
    scene.cluster.restart_hard(Duration::from_millis(200));
    tokio::time::timeout(Duration::from_mins(1), all_listen()).await.expect("both nodes listen again");
}

/// What is done once for all nodes is done by another when the one that did it dies.
#[tokio::test]
async fn tasks_that_one_node_does_move_when_it_dies() {
    let scene = Nodes::new();
    let pool = scene.connect().await;
    let holder = async || -> Option<String> {
        let select = "SELECT holder FROM leases WHERE name = 'upkeep' AND lease_until_ms > now_ms()";
        sqlx::query(select).fetch_optional(&pool).await.unwrap().map(|row| row.get(0))
    };
    let held = async |by_another_than: Option<&str>| loop {
        match holder().await {
            Some(holder) if Some(holder.as_str()) != by_another_than => break holder,
            _ => tokio::time::sleep(Duration::from_millis(100)).await,
        }
    };
    let first = scene.start(&["serve", "--workers", "0"]);
    let leader = tokio::time::timeout(Duration::from_mins(1), held(None)).await.expect("the only node leads");
    let _second = scene.start(&["serve", "--workers", "0"]);
    tokio::time::sleep(Duration::from_secs(7)).await;
    assert_eq!(holder().await.as_deref(), Some(leader.as_str()), "the second leaves it to the first");
    first.kill();
    // A request of long ago, which whoever leads deletes.
    let old =
        "INSERT INTO idempotency (owner, key, body_hash, result, created_at_ms) VALUES ('lab', 'old', '', '{}', 0)";
    sqlx::query(old).execute(&pool).await.unwrap();
    let next = tokio::time::timeout(Duration::from_mins(1), held(Some(&leader))).await.expect("the second takes over");
    assert_ne!(next, leader);
    let is_done = async || {
        let left = "SELECT COUNT(*) FROM idempotency";
        while sqlx::query_scalar::<_, i64>(left).fetch_one(&pool).await.unwrap() > 0 {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::time::timeout(Duration::from_mins(1), is_done()).await.expect("the second does what the first did");
}
