//! A disk and a network with faults while clients post: what was acknowledged is there, the rest was refused with a clear
//! answer, nothing sticks, and the service goes on without a restart once the fault is over.

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::store::db::Pool;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::support::audit::{audit, audit_books};
use crate::support::cluster::Cluster;
use crate::support::commands::{key, plumbline, succeeded};
use crate::support::database::is_postgres;
use crate::support::disk::{Disk, Faults};
use crate::support::line::{Line, Passes};
use crate::support::{PROGRAM, Service};

/// Number of clients that post at the same time.
const CLIENTS: usize = 4;
/// Time for which a fault lasts.
const LASTS: Duration = Duration::from_secs(3);

/// What clients heard.
#[derive(Default)]
struct Heard {
    acknowledged: Vec<String>,
    refused: usize,
}

/// Posts logs from several clients until `stop` is set.
async fn post(service: &Service, key: &str, stop: &AtomicBool) -> Heard {
    let client = plumbline::client::without_tls().timeout(Duration::from_secs(20)).build().unwrap();
    let one = |number: usize| {
        let (client, url) = (client.clone(), format!("{}/v1/submissions", service.url));
        async move {
            let mut heard = Heard::default();
            for i in (number..).step_by(CLIENTS) {
                if stop.load(Ordering::Relaxed) {
                    break;
                }
                let log = json!({ "palette": ["stone"], "rows": [[i, 0, 0, 0], [i, 1, 0, 0]] });
                let body = json!({ "task": 1, "turns": [log] });
                // Without an answer within its time, a client knows nothing.
                let Ok(answer) = client.post(&url).bearer_auth(key).json(&body).send().await else {
                    heard.refused += 1;
                    continue;
                };
                let (status, kind) = (answer.status(), answer.headers().get("content-type").cloned());
                let said: Value = answer.json().await.unwrap();
                if status == StatusCode::ACCEPTED {
                    heard.acknowledged.push(said["id"].as_str().unwrap().to_owned());
                    continue;
                }
                assert!(status.is_server_error(), "{status} {said}");
                assert_eq!(kind.unwrap(), "application/problem+json", "{said}");
                assert_eq!(said["retryable"], true, "{said}");
                heard.refused += 1;
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            heard
        }
    };
    let all = futures_util::future::join_all((0..CLIENTS).map(one)).await;
    all.into_iter().fold(Heard::default(), |mut sum, own| {
        sum.acknowledged.extend(own.acknowledged);
        sum.refused += own.refused;
        sum
    })
}

/// Posts while a fault begins, lasts and ends, and until the service accepts again. Returns what was heard.
async fn live_through(service: &Service, key: &str, begin: impl FnOnce(), end: impl FnOnce()) -> Heard {
    let stop = AtomicBool::new(false);
    let course = async {
        tokio::time::sleep(Duration::from_millis(500)).await;
        begin();
        tokio::time::sleep(LASTS).await;
        end();
        let begun = Instant::now();
        let body = json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }] });
        let request = || service.http.post(format!("{}/v1/submissions", service.url)).bearer_auth(key).json(&body);
        let request = || request().timeout(Duration::from_secs(5));
        while !request().send().await.is_ok_and(|answer| answer.status() == StatusCode::ACCEPTED) {
            assert!(begun.elapsed() < Duration::from_secs(40), "nothing is accepted after the fault");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        stop.store(true, Ordering::Relaxed);
    };
    let (heard, ()) = tokio::join!(post(service, key, &stop), course);
    heard
}

#[tokio::test]
async fn a_disk_that_fails_loses_nothing_that_was_acknowledged() {
    if is_postgres() {
        // The server has a disk of its own.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // SQLite writes the rest of what was written in part.
    let none = Faults::default();
    for (when, faults, refuses) in [
        ("writes fail", Faults { writes_fail: 30, ..none }, true),
        ("no room now and then", Faults { no_room: 30, ..none }, true),
        ("no room at all", Faults { no_room: 1_000, ..none }, true),
        ("short writes", Faults { short_writes: 100, ..none }, false),
        ("syncs fail", Faults { syncs_fail: 300, ..none }, true),
        ("no sync succeeds", Faults { syncs_fail: 1_000, ..none }, true),
        ("a slow disk", Faults { delay_us: 20_000, ..none }, false),
    ] {
        let home = folder.path().join(when.replace(' ', "-"));
        std::fs::create_dir(&home).unwrap();
        let database = home.join("p.db");
        let disk = Disk::new(folder.path(), &home);
        succeeded(&plumbline(&["migrate", "--create"], &database));
        let key = key(&database, "lab");
        let service = Service::start_by(disk.under(Command::new(PROGRAM)), &database, &["--lease-seconds", "1"]);
        let heard = live_through(&service, &key, || disk.set(faults), || disk.set(none)).await;
        assert!(disk.faults() > 0 || faults.delay_us > 0, "{when}");
        assert!(!heard.acknowledged.is_empty(), "{when}: nothing was acknowledged");
        assert_eq!(heard.refused > 0, refuses, "{when}: {} refused", heard.refused);
        service.settle(when).await;
        assert!(service.terminate(), "{when}");
        audit(&database, &heard.acknowledged, when).await;
    }
}

// The line passes bytes on while the test waits for the service.
#[tokio::test(flavor = "multi_thread")]
async fn a_line_to_the_server_that_fails_loses_nothing_that_was_acknowledged() {
    let cluster = Cluster::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    for fault in [Passes::Late, Passes::Nothing, Passes::Cut] {
        let (when, name) = (format!("{fault:?}"), format!("{fault:?}").to_lowercase());
        let secrets = folder.path().join(&name);
        cluster.create(&name);
        let line = Line::to(cluster.port).await;
        let url = cluster.url(&name);
        let run = |arguments: &[&str], url: &str| {
            let mut command = Command::new(PROGRAM);
            command.args(arguments).args(["--database", url, "--secrets"]).arg(&secrets);
            command
        };
        succeeded(&run(&["migrate", "--create"], &url).output().unwrap());
        let key = succeeded(&run(&["keys", "create", "--name", "lab"], &url).output().unwrap());
        let through = url.replace(&format!(":{}/", cluster.port), &format!(":{}/", line.port));
        let service = Service::launch(run(&["serve", "--lease-seconds", "1"], &through));
        let heard = live_through(&service, &key, || line.set(fault), || line.set(Passes::All)).await;
        assert!(!heard.acknowledged.is_empty(), "{when}: nothing was acknowledged");
        // Without an answer, requests may wait until another connection has one.
        let refuses = (fault != Passes::Nothing).then_some(fault == Passes::Cut);
        assert!(refuses.is_none_or(|refuses| refuses == (heard.refused > 0)), "{when}: {} refused", heard.refused);
        assert_eq!(line.dead() > 0, fault == Passes::Nothing, "{when}: {} connections are dead", line.dead());
        service.settle(&when).await;
        assert!(service.terminate(), "{when}");
        audit_books(&Pool::Postgres(sqlx::PgPool::connect(&url).await.unwrap()), &heard.acknowledged, &when).await;
    }
}
