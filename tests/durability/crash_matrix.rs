//! Whatever happens to the process, the disk, the clock or a row: no acknowledged submission is lost, none is graded
//! twice into the board, none is stuck, and the quota is exact.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::scene::{LEASE, Scene, on_threads, slow};
use crate::support::audit::audit;
use crate::support::database::{is_postgres, pool};
use crate::support::{PROGRAM, Service};
use plumbline::store::db::{Each, Text, query, query_scalar};
use reqwest::StatusCode;
use serde_json::{Value, json};
use sqlx::ConnectOptions as _;

async fn change(database: &Path, text: impl Into<Text>, id: &str) {
    let pool = pool(database).await;
    assert_eq!(query(text).bind(id).execute(&pool).await.unwrap(), 1);
    pool.close().await;
}

async fn killed(moment: String) {
    let mut scene = Scene::new();
    let service = scene.start_to_die(&moment);
    let _ = scene.work(&service).await;
    service.wait_for_end(&format!("{moment}, {}", scene.last())).await;
    scene.end_well(&moment).await;
}

#[tokio::test]
async fn killed_before_and_after_each_commit() {
    let commits = ["create_run", "accept", "claim", "renew", "record", "cancel", "finish_run", "note_key_uses"];
    let moments = commits.iter().flat_map(|commit| ["before", "after"].map(|side| format!("{side} {commit}")));
    on_threads(moments, 2, killed).await;
}

#[tokio::test]
async fn killed_while_an_unreadable_submission_ends() {
    for moment in ["before fail", "after fail"] {
        let mut scene = Scene::new();
        let service = scene.start_to_die("before claim");
        let id = scene.post(&service, slow()).await;
        service.wait_for_end(moment).await;
        let Some(id) = id else { continue };
        change(
            &scene.database,
            Each {
                sqlite: "UPDATE submissions SET log = x'00' WHERE id = $1",
                postgres: r"UPDATE submissions SET log = '\x00' WHERE id = $1",
            },
            &id,
        )
        .await;
        scene.start_and_die(moment);
        scene.end_well(moment).await;
        let service = scene.start();
        let submission = service.get(&format!("/v1/submissions/{id}")).await.json();
        assert_eq!(submission["state"], "grader_error", "{submission}");
    }
}

#[tokio::test]
async fn killed_while_work_is_given_back_and_while_it_is_given_up() {
    let mut scene = Scene::new();
    // A lease that ends while the machine is busy would use up an attempt.
    scene.lease = ["--lease-seconds", "4"];
    let service = scene.start_to_die("before give_back");
    scene.post(&service, slow()).await.unwrap();
    let waiting = format!("/v1/submissions/{}", scene.acknowledged[0]);
    service.wait_for(&waiting, |submission| submission["state"] == "grading").await;
    service.signal("TERM");
    service.wait_for_end("before give_back").await;
    // Three attempts that die with the process, then the fourth look, which gives up.
    for moment in ["before record", "before record", "before claim (given up)", "after claim (given up)"] {
        scene.start_and_die(moment);
    }
    scene.end_well("given up").await;
    let service = scene.start();
    assert_eq!(service.get(&waiting).await.json()["state"], "grader_error");
}

/// Returns the attempt at a submission that is being graded, 0 if it waits, none or has ended; or nothing while somebody
/// holds the lock of the file. PostgreSQL has no such lock.
async fn attempt_in_database(database: &Path, id: &str) -> Option<i64> {
    if !is_postgres() {
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(database).busy_timeout(Duration::from_secs(1));
        let mut connection = options.connect().await.unwrap();
        sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await.ok()?;
    }
    let pool = pool(database).await;
    let attempt = query_scalar("SELECT attempt FROM jobs WHERE submission_id = $1 AND lease_until_ms > 0");
    let attempt: Option<i64> = attempt.bind(id).fetch_optional(&pool).await.unwrap();
    pool.close().await;
    Some(attempt.unwrap_or(0))
}

/// Posts work and stops the service in the middle of it. Returns the work, and which attempt at it was stopped.
async fn stopped_at_work(scene: &mut Scene, service: &Service) -> (String, i64) {
    for _ in 0..20 {
        let id = scene.post(service, slow()).await.unwrap();
        service.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] != "queued").await;
        // Stopped in the middle of a transaction it would hold the lock of the file, which no lease ends. A fast machine
        // may also have graded the work before it is stopped.
        for _ in 0..20 {
            service.signal("STOP");
            let attempt = attempt_in_database(&scene.database, &id).await;
            if let Some(attempt) = attempt.filter(|attempt| *attempt > 0) {
                return (id, attempt);
            }
            service.signal("CONT");
            if attempt.is_some() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    panic!("the service was never stopped at work");
}

#[tokio::test]
async fn a_worker_that_slept_over_its_lease_is_too_late() {
    let mut scene = Scene::new();
    let sleeper = scene.start();
    let (id, stopped) = stopped_at_work(&mut scene, &sleeper).await;
    let path = format!("/v1/submissions/{id}");
    let other = scene.start();
    other.wait_for(&path, |submission| submission["state"] == "graded").await;
    let report = other.get(&format!("{path}/report")).await.json();
    // More than one attempt later, a busy machine could not renew a lease in its second.
    assert!(report["provenance"]["attempt"].as_i64().unwrap() > stopped, "{report}");
    sleeper.signal("CONT");
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(sleeper.terminate() && other.terminate());
    audit(&scene.database, &scene.acknowledged, "slept").await;
}

#[tokio::test]
async fn two_services_on_one_file() {
    let mut scene = Scene::new();
    let services = [scene.start(), scene.start()];
    let _ = scene.work(&services[0]).await;
    for i in 0..200 {
        let log = json!({ "palette": ["stone"], "rows": [[i, 0, 0, 0]] });
        scene.post(&services[i % 2], json!({ "task": 1, "turns": [log] })).await.unwrap();
    }
    services[0].settle("two").await;
    for service in services {
        assert!(service.terminate());
    }
    audit(&scene.database, &scene.acknowledged, "two").await;
}

#[tokio::test]
async fn a_clock_that_jumps() {
    const HOUR_MS: i64 = 3_600_000;
    let mut scene = Scene::new();
    let clock = scene.database.with_extension("clock");
    let set = |ms: i64| std::fs::write(&clock, ms.to_string()).unwrap();
    set(0);
    let mut command = Command::new(PROGRAM);
    command.env("PLUMBLINE_TEST_CLOCK", &clock);
    let service = Service::start_by(command, &scene.database, &LEASE);
    for jump in [HOUR_MS, -HOUR_MS, 0] {
        let _ = scene.work(&service).await;
        set(jump);
        service.settle("clock").await;
    }
    // Killed with a lease that ends in an hour by the clock that comes after.
    set(HOUR_MS);
    scene.post(&service, slow()).await.unwrap();
    service
        .wait_for(&format!("/v1/submissions/{}", scene.acknowledged.last().unwrap()), |s| s["state"] == "grading")
        .await;
    service.kill();
    scene.end_well("clock").await;
}

#[tokio::test]
async fn a_disk_without_room() {
    if is_postgres() {
        // The server has a disk of its own.
        return;
    }
    let mut scene = Scene::new();
    assert!(scene.start().terminate());
    // No file may grow beyond the database and a little more; writing further fails, as on a full disk.
    let room = std::fs::metadata(&scene.database).unwrap().len() + (64 << 10);
    let mut command = Command::new("sh");
    let limited = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", room / 512);
    command.args(["-c", &limited, PROGRAM]);
    let service = Service::start_by(command, &scene.database, &LEASE);
    let mut refused = None;
    for i in 0..20_000 {
        // Logs that do not compress.
        let rows: Vec<Value> = (0..500_u64)
            .map(|j| {
                let at = (i * 500 + j).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                json!([at >> 44 & 1023, at >> 34 & 63, at >> 24 & 1023, 0])
            })
            .collect();
        let body = json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": rows }] });
        let request = service.http.post(format!("{}/v1/submissions", service.url)).bearer_auth(&scene.key).json(&body);
        let answer = service.send(request).await;
        if answer.status != StatusCode::ACCEPTED {
            refused = Some(answer);
            break;
        }
        scene.acknowledged.push(answer.json()["id"].as_str().unwrap().to_owned());
    }
    let refused = refused.expect("the disk did not fill");
    assert!(refused.status.is_server_error(), "{}", refused.text);
    assert_eq!(
        (refused.json()["retryable"].as_bool(), refused.kind.as_str()),
        (Some(true), "application/problem+json")
    );
    assert_eq!(service.get("/healthz").await.status, StatusCode::OK);
    assert!(!scene.acknowledged.is_empty());
    service.kill();
    scene.end_well("full").await;
}

#[tokio::test]
async fn corrupt_rows_harm_nobody_else() {
    let mut scene = Scene::new();
    let service = scene.start();
    for agent in ["whole", "torn"] {
        let begin = service
            .http
            .post(format!("{}/v1/runs", service.url))
            .json(&json!({ "agent": agent, "suite": "mineceraft" }));
        let run = scene.send(begin).await.unwrap()["id"].as_str().unwrap().to_owned();
        let log = json!({ "palette": ["stone"], "rows": [[0, 0, 0, 0]] });
        scene.post(&service, json!({ "run": run, "task": 1, "turns": [log] })).await.unwrap();
        let finish = service.http.post(format!("{}/v1/runs/{run}/finish", service.url));
        scene.send(finish.json(&json!({ "skip": "unanswered" }))).await.unwrap();
        service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
        if agent == "torn" {
            change(&scene.database, "UPDATE results SET summary = '{' WHERE run_id = $1", &run).await;
        }
    }
    let torn = scene.acknowledged[1].clone();
    let broken = Each {
        sqlite: "UPDATE reports SET body = x'28B52FFD' WHERE submission_id = $1",
        postgres: r"UPDATE reports SET body = '\x28B52FFD' WHERE submission_id = $1",
    };
    change(&scene.database, broken, &torn).await;
    tokio::time::sleep(Duration::from_millis(1_100)).await;
    let report = service.get(&format!("/v1/submissions/{torn}/report")).await;
    assert_eq!((report.status, report.kind.as_str()), (StatusCode::INTERNAL_SERVER_ERROR, "application/problem+json"));
    let whole = service.get(&format!("/v1/submissions/{}/report", scene.acknowledged[0])).await;
    assert_eq!(whole.status, StatusCode::OK);
    let board = service.get("/v1/leaderboards/mineceraft").await;
    let rows = board.json()["rows"].as_array().unwrap().clone();
    let agents: Vec<&Value> = rows.iter().map(|row| &row["agent"]).collect();
    assert_eq!(agents, ["whole"], "{}", board.text);
    assert_eq!(service.get("/").await.status, StatusCode::OK);
    let metrics = service.get("/metrics").await.text;
    assert!(metrics.contains("plumbline_corrupt_rows_total"), "the damage must be seen");
}
