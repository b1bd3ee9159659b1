//! A database file that is deleted, moved or replaced while the service runs.

use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::support::{PROGRAM, Service};

#[tokio::test]
async fn a_file_that_is_gone_is_told_while_the_service_runs() {
    if crate::support::database::is_postgres() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    std::fs::rename(&database, folder.path().join("aside.db")).unwrap();
    // Nothing is acknowledged that would be lost.
    let body = json!({ "task": 113, "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }] });
    for path in ["/v1/submissions", "/v1/runs"] {
        let body = if path == "/v1/runs" { json!({ "agent": "x", "suite": "mineceraft" }) } else { body.clone() };
        let refused = service.post_json(path, &body).await;
        assert_eq!(refused.status.as_u16(), 503, "{path}: {}", refused.text);
        assert!(refused.text.contains("is not where it was"), "{}", refused.text);
    }
    let gone = service.wait_for("/readyz", |ready| ready["status"].is_null() || ready["status"] != "ok").await;
    assert!(gone["detail"].as_str().unwrap().contains("was deleted, moved or replaced"), "{gone}");
    // Nothing takes its place while the process writes to the old one.
    let aside = folder.path().join("aside.db");
    let beside = |file: &str| ["-wal", "-shm"].map(|ending| folder.path().join(format!("{file}{ending}")));
    let move_log = |from: &str, to: &str| {
        for (from, to) in beside(from).iter().zip(beside(to)) {
            std::fs::rename(from, to).unwrap();
        }
    };
    move_log("p.db", "aside.db");
    let refused = Command::new(PROGRAM).arg("restore").arg(&aside).arg("--database").arg(&database).output().unwrap();
    assert!(String::from_utf8_lossy(&refused.stderr).contains("stop it first"), "{refused:?}");
    std::fs::rename(&aside, &database).unwrap();
    move_log("aside.db", "p.db");
    service.wait_for("/readyz", |ready| ready["status"] == "ok").await;
    assert_eq!(service.post_json("/v1/submissions", &body).await.status.as_u16(), 202);
    // Where another file takes its place, that file is not damaged by the log of the first.
    let other = folder.path().join("other.db");
    drop(Service::start(&other, &[]));
    let before = std::fs::read(&other).unwrap();
    std::fs::rename(&other, &database).unwrap();
    let lost = folder.path().join("p.db-wal.lost");
    service.wait_for("/v1/suites", |_| lost.exists()).await;
    assert!(std::fs::read(&database).unwrap() == before && !folder.path().join("p.db-wal").exists());
    // Nor does it touch the log of the service that takes over, which may hold all that was acknowledged.
    let successor = Service::start(&database, &[]);
    let accepted = successor.post_json("/v1/submissions", &body).await;
    assert_eq!(accepted.status.as_u16(), 202, "{}", accepted.text);
    successor.kill();
    let looks = || service.said.lock().unwrap().iter().filter(|line| line.contains("was deleted, moved")).count();
    let looked = looks();
    service.wait_for("/v1/suites", |_| looks() >= looked + 2).await;
    let stopped = Command::new("kill").args(["-TERM", &service.process_id().to_string()]).status().unwrap();
    assert!(stopped.success());
    let begun = Instant::now();
    while std::fs::exists(format!("/proc/{}/fd/0", service.process_id())).unwrap_or(false)
        && begun.elapsed() < Duration::from_secs(10)
    {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let second = std::fs::exists(folder.path().join("p.db-wal.lost-2")).unwrap();
    assert!(folder.path().join("p.db-wal").exists() && !second, "{:?}", service.said.lock().unwrap());
    let service = Service::start(&database, &[]);
    let found = service.get(&format!("/v1/submissions/{}", accepted.json()["id"].as_str().unwrap())).await;
    assert_eq!(found.status.as_u16(), 200, "{}", found.text);
    // A worker makes no database of its own.
    let nowhere = folder.path().join("misspelt.db");
    let mut work = Command::new(PROGRAM);
    work.args(["work", "--listen", "127.0.0.1:0", "--database"]).arg(&nowhere);
    let refused = work.output().unwrap();
    assert!(!refused.status.success() && !nowhere.exists(), "{refused:?}");
}
