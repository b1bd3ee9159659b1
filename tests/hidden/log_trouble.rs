//! What the transparency log does when its key changes, and when what is stored of it is damaged.

use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::Output;

use plumbline::store::db::{Each, query};
use serde_json::Value;

use crate::support::Service;
use crate::support::commands::{refused, succeeded};
use crate::support::database::pool;

fn witness(state: &Path, url: &str, more: &[&str]) -> Output {
    let mut command = std::process::Command::new(crate::support::PROGRAM);
    command.args(["witness", url, "--state"]).arg(state).args(more).output().unwrap()
}

/// Starts the service with a new receipt key, as after the old one was lost.
fn with_new_key(database: &Path) -> Service {
    std::fs::remove_file(database.with_extension("db.secrets").join("receipts.key")).unwrap();
    Service::start(database, &["--new-receipt-key"])
}

#[tokio::test]
async fn a_witness_follows_a_log_whose_key_was_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (database, state) = (folder.path().join("p.db"), folder.path().join("seen.json"));
    let service = Service::start(&database, &[]);
    service.finished_run("first", 0).await;
    let old = service.get("/log/key").await.text;
    let early = succeeded(&witness(&state, &service.url, &["--log-key", &old]));
    drop(service);

    let service = with_new_key(&database);
    service.finished_run("second", 0).await;
    let new = service.get("/log/key").await.text;
    assert_ne!(old, new);
    let told = refused(&witness(&state, &service.url, &[]));
    assert!(told.starts_with("BROKEN  the checkpoint is not signed") && told.contains("--new-log-key"), "{told}");
    assert!(refused(&witness(&state, &service.url, &["--log-key", &new])).contains("--new-log-key"));
    let another = new.replacen("log/", "log/0", 1);
    for wrong in ["x", another.as_str()] {
        assert!(
            refused(&witness(&state, &service.url, &["--new-log-key", wrong])).contains("--new-log-key"),
            "{wrong}"
        );
    }
    // The key before is not the new one; and what was refused changed nothing.
    let told = refused(&witness(&state, &service.url, &["--new-log-key", &old]));
    assert!(told.contains("BROKEN"), "{told}");

    succeeded(&witness(&state, &service.url, &["--new-log-key", &new]));
    service.finished_run("third", 0).await;
    succeeded(&witness(&state, &service.url, &[]));
    // Said twice, it is no second change.
    succeeded(&witness(&state, &service.url, &["--new-log-key", &new]));
    let kept: Value = serde_json::from_slice(&std::fs::read(&state).unwrap()).unwrap();
    assert_eq!(kept["log_key"], new.trim());
    assert_eq!(kept["replaced"].as_array().unwrap().len(), 1, "{kept}");
    assert_eq!(
        (kept["replaced"][0]["log_key"].as_str(), kept["replaced"][0]["note"].as_str().map(str::trim_end)),
        (Some(old.trim()), Some(early.as_str()))
    );
}

#[tokio::test]
async fn a_new_key_does_not_hide_another_history() {
    let folder = tempfile::tempdir().unwrap();
    let (database, state) = (folder.path().join("p.db"), folder.path().join("seen.json"));
    let service = Service::start(&database, &[]);
    service.finished_run("first", 0).await;
    let old = service.get("/log/key").await.text;
    succeeded(&witness(&state, &service.url, &["--log-key", &old]));
    drop(service);

    damage(&database, "seq > 3").await;
    let service = with_new_key(&database);
    let new = service.get("/log/key").await.text;
    let output = witness(&state, &service.url, &["--new-log-key", &new]);
    assert_eq!(output.status.code(), Some(1));
    let told = refused(&output);
    assert!(told.contains("BROKEN  the service shows another history") && told.contains("another file"), "{told}");
}

#[tokio::test]
async fn a_witness_accuses_nobody_of_what_it_cannot_tell() {
    let folder = tempfile::tempdir().unwrap();
    let (database, state) = (folder.path().join("p.db"), folder.path().join("seen.json"));
    let service = Service::start(&database, &[]);
    service.finished_run("first", 0).await;
    let key = service.get("/log/key").await.text;
    succeeded(&witness(&state, &service.url, &["--log-key", &key]));
    // A proxy that answers everything with a page of its own.
    let proxy = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", proxy.local_addr().unwrap());
    std::thread::spawn(move || {
        for mut connection in proxy.incoming().flatten() {
            let _read = connection.read(&mut [0; 4_096]);
            let page = "<html>Please sign in</html>";
            let head = format!("HTTP/1.1 200 OK\r\ncontent-length: {}\r\nconnection: close\r\n\r\n", page.len());
            connection.write_all(format!("{head}{page}").as_bytes()).unwrap();
        }
    });
    let output = witness(&state, &url, &[]);
    assert_eq!(output.status.code(), Some(2), "{}", refused(&output));
    assert!(refused(&output).contains("is no checkpoint, but begins with \"<html>Please"), "{}", refused(&output));
    // A state that forgot what its own checkpoint says.
    let mut kept: Value = serde_json::from_slice(&std::fs::read(&state).unwrap()).unwrap();
    (kept["frontier"]["size"], kept["frontier"]["roots"]) = (0.into(), Value::Array(Vec::new()));
    std::fs::write(&state, kept.to_string()).unwrap();
    let output = witness(&state, &service.url, &[]);
    assert_eq!(output.status.code(), Some(2), "{}", refused(&output));
    assert!(refused(&output).contains("seen.json is damaged"), "{}", refused(&output));
}

#[tokio::test]
async fn damage_to_the_stored_log_shows_and_is_not_said_to_pass() {
    let folder = tempfile::tempdir().unwrap();
    for (name, gone) in [("gap", "seq = 7"), ("tail", "seq > 7")] {
        let database = folder.path().join(name).with_extension("db");
        let service = Service::start(&database, &[]);
        service.finished_run("first", 0).await;
        assert!(service.get("/readyz").await.json().get("lacks").is_none());
        let state = folder.path().join(name);
        let key = service.get("/log/key").await.text;
        let output = witness(&state, &service.url, &["--log-key", &key, "--name", "w.example"]);
        let told = String::from_utf8(output.stderr).unwrap();
        let own = told.lines().find_map(|line| line.strip_prefix("cosigned as ")).unwrap();
        drop(service);
        let service = Service::start(&database, &["--witness", own]);
        succeeded(&witness(&state, &service.url, &["--name", "w.example", "--publish"]));
        drop(service);

        damage(&database, gone).await;
        let service = Service::start(&database, &["--witness", own]);
        let told = service.wait_for("/readyz", |ready| ready.get("lacks").is_some()).await;
        assert_eq!(told["lacks"][0], "intact log of receipts", "{name}");
        if name == "gap" {
            let answer = service.get("/log/checkpoint").await;
            let problem = answer.json();
            assert_eq!((answer.status.as_u16(), &problem["retryable"]), (500, &Value::Bool(false)), "{problem}");
            assert_eq!(problem["type"], "urn:plumbline:problem:damaged");
            assert!(answer.headers.get("retry-after").is_none());
        }
        // Everything else goes on, and entries that come later do not hide what is missing.
        service.finished_run("second", 0).await;
        service.finished_run("third", 0).await;
        drop(service);
        let service = Service::start(&database, &["--witness", own]);
        let told = service.wait_for("/readyz", |ready| ready.get("lacks").is_some()).await;
        assert_eq!(told["lacks"][0], "intact log of receipts", "{name}");
        assert!(service.get("/metrics").await.text.contains("plumbline_corrupt_rows_total 1"), "{name}");
    }
}

/// Deletes receipts behind the service's back, as only somebody with the file can.
async fn damage(database: &Path, gone: &str) {
    let pool = pool(database).await;
    let trigger = Each { sqlite: "DROP TRIGGER receipts_stay", postgres: "DROP TRIGGER receipts_stay ON receipts" };
    query(trigger).execute(&pool).await.unwrap();
    let delete = sqlx::AssertSqlSafe(format!("DELETE FROM receipts WHERE {gone}"));
    assert!(query(delete).execute(&pool).await.unwrap() > 0);
    pool.close().await;
}
