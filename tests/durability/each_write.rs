//! No room for one write, in turn for each write of a piece of work: whatever commit it belongs to is refused whole or
//! made good later, and the service goes on.

use std::path::PathBuf;
use std::process::Command;

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::scene::on_threads;
use crate::support::audit::audit;
use crate::support::commands::{key, plumbline, succeeded};
use crate::support::database::is_postgres;
use crate::support::disk::Disk;
use crate::support::{PROGRAM, Service};

/// Number of services among which the writes are shared, so that they wait for leases at the same time.
const SERVICES: u32 = 6;

/// Sends a request until it is done, and gives the answer; what has no room must be worth trying again. `None` where the
/// service says that it cannot be done any more.
async fn insist(service: &Service, path: &str, body: &Value, refusals: &mut u32) -> Option<Value> {
    for _ in 0..20 {
        let answer = service.post_json(path, body).await;
        if answer.status.is_success() {
            return Some(answer.json());
        }
        if answer.status == StatusCode::CONFLICT {
            return None;
        }
        assert_eq!(answer.kind, "application/problem+json", "{path}: {}", answer.text);
        assert!(answer.status.is_server_error() && answer.json()["retryable"] == true, "{path}: {}", answer.text);
        *refusals += 1;
    }
    panic!("{path} is refused without end");
}

/// Begins a run, answers two of its tasks, cancels one, finishes it, and waits for the grades. Returns what was
/// acknowledged.
async fn work(service: &Service, refusals: &mut u32) -> Vec<String> {
    let run = insist(service, "/v1/runs", &json!({ "agent": "a", "suite": "mineceraft" }), refusals).await.unwrap();
    let run = run["id"].as_str().unwrap().to_owned();
    let mut acknowledged = Vec::new();
    for task in 1..4 {
        let log = json!({ "palette": ["stone"], "rows": [[task, 0, 0, 0]] });
        let body = json!({ "run": run, "task": task, "turns": [log] });
        let accepted = insist(service, "/v1/submissions", &body, refusals).await.unwrap();
        acknowledged.push(accepted["id"].as_str().unwrap().to_owned());
    }
    insist(service, &format!("/v1/submissions/{}/cancel", acknowledged[2]), &Value::Null, refusals).await;
    insist(service, &format!("/v1/runs/{run}/finish"), &json!({ "skip": "unanswered" }), refusals).await;
    service.settle("a write had no room").await;
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    acknowledged
}

/// Does the work once for each write of it from `first` on, in steps of [`SERVICES`]. Returns the number of writes that
/// had no room and of requests that were refused.
async fn each_write_from((first, folder): (u32, PathBuf)) -> (u32, u32) {
    let home = folder.join(format!("{first}"));
    let tools = folder.join(format!("{first}-tools"));
    for folder in [&home, &tools] {
        std::fs::create_dir(folder).unwrap();
    }
    let database = home.join("p.db");
    let disk = Disk::new(&tools, &home);
    succeeded(&plumbline(&["migrate", "--create"], &database));
    let key = key(&database, "lab");
    let command = disk.under(Command::new(PROGRAM));
    let mut service = Service::start_by(command, &database, &["--lease-seconds", "1"]);
    service.use_key(Some(&key));
    let (mut acknowledged, mut refusals, mut write) = (Vec::new(), 0, first);
    loop {
        disk.refuse_after(write);
        acknowledged.extend(work(&service, &mut refusals).await);
        if !disk.has_refused() {
            break;
        }
        write += SERVICES;
    }
    assert!(service.terminate());
    audit(&database, &acknowledged, "a write had no room").await;
    (disk.faults(), refusals)
}

#[tokio::test]
async fn no_room_for_any_one_write() {
    if is_postgres() {
        // The server has a disk of its own.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let parts = (0..SERVICES).map(|first| (first, folder.path().to_owned()));
    let told = on_threads(parts, SERVICES as usize, each_write_from).await;
    let (faults, refusals) = told.into_iter().fold((0, 0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
    println!("{faults} writes had no room, {refusals} requests were refused");
    assert!(faults > 50 && refusals > 10, "{faults} writes had no room, {refusals} requests were refused");
}
