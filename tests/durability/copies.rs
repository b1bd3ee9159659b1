//! Backup while the service takes submissions, restore, and export: nothing that was acknowledged before is missing.

use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use crate::support::{PROGRAM, Service};
use serde_json::{Value, json};

fn plumbline(command: &str, target: &Path, database: &Path) -> Output {
    Command::new(PROGRAM).arg(command).arg(target).args(crate::support::database::named(database)).output().unwrap()
}

fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn lines(file: &Path) -> Vec<Value> {
    std::fs::read_to_string(file).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A board without the times at which its runs ended.
fn untimed(mut board: Value) -> Value {
    for rows in ["rows", "reported"] {
        for row in board[rows].as_array_mut().into_iter().flatten() {
            row.as_object_mut().unwrap().remove("finished_at");
        }
    }
    board
}

/// A run with some answers, finished.
async fn finished_run(service: &Service, agent: &str) -> Value {
    let run = service.begin_run(agent, "mineceraft").await;
    let line = |task: u32| {
        json!({ "run": run, "task": task, "turns": [{ "palette": ["stone"], "rows": [[0, 0, task, 0], [1, 0, task, 0]] }] }).to_string()
    };
    let body: Vec<String> = (1..=40).map(line).collect();
    assert_eq!(service.post("/v1/submissions", "application/x-ndjson", body.join("\n")).await.status, 202);
    service.post_json(&format!("/v1/runs/{run}/finish"), &json!({})).await;
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await
}

/// Restores a backup with a byte that changed on the way, wherever it is.
fn a_changed_byte_is_told(folder: &Path) {
    let path = |name: &str| folder.join(name);
    let mut bytes = std::fs::read(path("copy.db")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(path("changed.db"), bytes).unwrap();
    std::fs::copy(path("copy.db.sha256"), path("changed.db.sha256")).unwrap();
    let taken = plumbline("restore", &path("changed.db"), &path("changed"));
    assert!(String::from_utf8_lossy(&taken.stderr).contains("was changed or cut off"), "{taken:?}");
    assert!(!path("changed").exists());
}

/// Imports an export whose end is missing, and one that was not finished; then it is whole again.
fn lost_lines_are_told(folder: &Path) {
    let path = |name: &str| folder.join("lines").join(name);
    let is_refused = |why: &str| {
        let output = plumbline("import", &folder.join("lines"), &folder.join("imported.db"));
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && told.contains(why), "{told}");
    };
    let whole = std::fs::read_to_string(path("reports.ndjson")).unwrap();
    let cut = whole.trim_end().rfind('\n').unwrap();
    std::fs::write(path("reports.ndjson"), &whole[..=cut]).unwrap();
    is_refused("reports.ndjson was changed or cut off");
    std::fs::write(path("reports.ndjson"), &whole).unwrap();
    std::fs::write(path("SHA256SUMS.unfinished"), "").unwrap();
    is_refused("an export that was interrupted");
    std::fs::remove_file(path("SHA256SUMS.unfinished")).unwrap();
}

#[tokio::test]
async fn a_backup_of_a_running_service_restores_to_the_same_answers() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let service = Service::start(&path("p.db"), &["--lease-seconds", "2"]);
    let run = finished_run(&service, "before").await;
    let id = run["id"].as_str().unwrap();
    // Others go on posting meanwhile.
    let (_, told) = tokio::join!(finished_run(&service, "meanwhile"), async {
        let (copy, database) = (path("copy.db"), path("p.db"));
        tokio::task::spawn_blocking(move || succeeded(&plumbline("backup", &copy, &database))).await.unwrap()
    });
    assert!(told.contains(" submissions, ") && told.contains("copy.db: "), "{told}");
    let submissions = service.get(&format!("/v1/runs/{id}/submissions?limit=1000")).await.json();
    let first = submissions["submissions"][0]["id"].as_str().unwrap().to_owned();
    let report = service.get(&format!("/v1/submissions/{first}/report")).await.text;
    let again = plumbline("backup", &path("copy.db"), &path("p.db"));
    assert!(String::from_utf8_lossy(&again.stderr).contains("already exists"), "a copy is never overwritten");
    let taken = plumbline("restore", &path("copy.db"), &path("p.db"));
    assert!(String::from_utf8_lossy(&taken.stderr).contains("move it away first"), "nor a database");
    service.kill();

    a_changed_byte_is_told(folder.path());
    succeeded(&plumbline("restore", &path("copy.db"), &path("restored.db")));
    let restored = Service::start(&path("restored.db"), &["--new-receipt-key"]);
    assert_eq!(restored.get(&format!("/v1/runs/{id}")).await.json(), run);
    assert_eq!(restored.get(&format!("/v1/runs/{id}/submissions?limit=1000")).await.json(), submissions);
    assert_eq!(restored.get(&format!("/v1/submissions/{first}/report")).await.text, report);
    // What was queued at that moment is graded now.
    restored.wait_for("/readyz", |_| true).await;
    finished_run(&restored, "after").await;
    let whole = restored.finished_run("whole", 3).await;
    let hide = json!({ "action": "hide", "reason": "a trial" });
    let admin = plumbline_key(&path("restored.db"), "admin");
    for action in [&hide, &json!({ "action": "restore", "reason": "no trial" })] {
        let request = restored.http.post(format!("{}/v1/runs/{whole}/board-actions", restored.url)).bearer_auth(&admin);
        assert_eq!(restored.send(request.json(action)).await.status, 200);
    }

    // Everything as lines, from the running service's file.
    let exported = succeeded(&plumbline("export", &path("lines"), &path("restored.db")));
    assert!(exported.contains("reports.ndjson: "), "{exported}");
    let runs = lines(&path("lines/runs.ndjson"));
    let found = runs.iter().find(|line| line["id"] == id).unwrap();
    assert_eq!((&found["summary"], &found["agent"]), (&run["summary"], &json!("before")));
    let logs = lines(&path("lines/submissions.ndjson"));
    let found = logs.iter().find(|line| line["id"] == first.as_str()).unwrap();
    assert_eq!(found["log"]["turns"], json!([[[0, 0, 1, 0], [1, 0, 1, 0]]]));
    let reports = lines(&path("lines/reports.ndjson"));
    let found = reports.iter().find(|line| line["submission"] == first.as_str()).unwrap();
    let shown: Value = serde_json::from_str(&report).unwrap();
    for part in ["overall", "criteria", "turns"] {
        assert_eq!(found["report"][part], shown[part]);
    }

    // And into an empty service, which then has the same boards; once, and whole or not at all.
    let imported = Service::start(&path("imported.db"), &[]);
    lost_lines_are_told(folder.path());
    let told = succeeded(&plumbline("import", &path("lines"), &path("imported.db")));
    assert!(told.contains(&format!("runs: {}", runs.len())), "{told}");
    for suite in ["mineceraft", "mineceraft-lite"] {
        for part in ["", "/actions", "/breakdown", "?coverage=incomplete"] {
            let place = format!("/v1/leaderboards/{suite}{part}");
            // Jobs that were under way when the copy was made are taken again when their lease has ended; what is
            // imported is queued at once.
            let begun = Instant::now();
            loop {
                let boards = (imported.get(&place).await.json(), restored.get(&place).await.json());
                // A run whose last answers wait in the copy ends in each of them by itself.
                let boards = (untimed(boards.0), untimed(boards.1));
                if boards.0 == boards.1 {
                    break;
                }
                assert!(begun.elapsed() < Duration::from_mins(3), "{place}: {boards:#?}");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
    let place = format!("/v1/submissions/{first}");
    for part in ["", "/report", "/log"] {
        let place = format!("{place}{part}");
        assert_eq!(imported.get(&place).await.text, restored.get(&place).await.text);
    }
    // A log is in a form that can be posted.
    let again = json!({ "task": found_task(&logs, &first), "log": logs[0]["log"] });
    assert_eq!(imported.post_json("/v1/validate", &again).await.status, 200);
    let again = plumbline("import", &path("lines"), &path("imported.db"));
    assert!(String::from_utf8_lossy(&again.stderr).contains("an import needs an empty one"));
    finished_run(&imported, "later").await;

    // A line that was tampered with is named, and nothing is taken.
    let file = path("lines/submissions.ndjson");
    let text = std::fs::read_to_string(&file).unwrap();
    let line = text.lines().position(|line| line.contains(&first)).unwrap() + 1;
    // Whoever changes an export on purpose deletes its checksums.
    std::fs::remove_file(path("lines/SHA256SUMS")).unwrap();
    std::fs::write(&file, text.replacen("[[[0,0,1,0],[1,0,1,0]]]", "[[[0,0,1,0],[2,0,1,0]]]", 1)).unwrap();
    drop(Service::start(&path("tampered.db"), &[]));
    let refused = plumbline("import", &path("lines"), &path("tampered.db"));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains(&format!("submissions.ndjson, line {line}")) && said.contains("SHA-256"), "{said}");
    std::fs::write(&file, text).unwrap();
    succeeded(&plumbline("import", &path("lines"), &path("tampered.db")));
}

#[tokio::test]
async fn keys_are_not_mixed_with_those_of_another_database() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let serve = |database: &Path| {
        let mut limited = Command::new("timeout");
        let output =
            limited.args(["20", PROGRAM, "serve", "--listen", "127.0.0.1:0", "--database"]).arg(database).output();
        String::from_utf8(output.unwrap().stderr).unwrap()
    };
    let service = Service::start(&path("p.db"), &[]);
    service.finished_run("first", 0).await;
    drop(service);
    let with_secrets = |command: &str, database: &Path| {
        let mut run = Command::new(PROGRAM);
        run.args([command, "--with-secrets"]).arg(path("copy.db")).arg("--database").arg(database).output().unwrap()
    };
    succeeded(&with_secrets("backup", &path("p.db")));

    // A database that is gone is no reason to begin another under its key.
    std::fs::rename(path("p.db"), path("away.db")).unwrap();
    let told = serve(&path("p.db"));
    assert!(told.contains("holds the keys of one") && told.contains("plumbline restore"), "{told}");
    assert!(!path("p.db").exists(), "nothing is made");
    std::fs::write(path("p.db"), "").unwrap();
    let told = serve(&path("p.db"));
    assert!(told.contains("is missing or empty") && std::fs::read(path("p.db")).unwrap().is_empty(), "{told}");
    let told = Command::new(PROGRAM).args(["migrate", "--database"]).arg(path("p.db")).output().unwrap();
    let told = String::from_utf8(told.stderr).unwrap();
    assert!(told.contains("is missing or empty") && std::fs::read(path("p.db")).unwrap().is_empty(), "{told}");
    std::fs::remove_file(path("p.db")).unwrap();
    let told = Command::new(PROGRAM).args(["check", "--database"]).arg(folder.path()).output().unwrap();
    let told = String::from_utf8(told.stderr).unwrap();
    assert!(told.contains("is a folder: name a file in it"), "{told}");

    // Keys of another database are not touched, and none is copied to them.
    drop(Service::start(&path("q.db"), &[]));
    std::fs::remove_file(path("q.db")).unwrap();
    for left in ["q.db-wal", "q.db-shm"] {
        let _ = std::fs::remove_file(path(left));
    }
    std::fs::write(path("copy.db.secrets/epoch-x.json"), "{}").unwrap();
    let told = String::from_utf8(with_secrets("restore", &path("q.db")).stderr).unwrap();
    assert!(told.contains("receipts.key") && told.contains("without --with-secrets"), "{told}");
    assert!(!path("q.db").exists() && !path("q.db.secrets/epoch-x.json").exists());

    for left in ["p.db-wal", "p.db-shm"] {
        let _ = std::fs::remove_file(path(left));
    }
    succeeded(&with_secrets("restore", &path("p.db")));
    let service = Service::start(&path("p.db"), &[]);
    assert_eq!(service.get("/v1/leaderboards/mineceraft-lite").await.json()["total"], 1);
}

/// The id of a submission's task in an export.
fn found_task(logs: &[Value], submission: &str) -> Value {
    assert!(logs.iter().any(|line| line["id"] == submission && line["task"].is_string()), "{logs:?}");
    logs[0]["task"].clone()
}

fn plumbline_key(database: &Path, scopes: &str) -> String {
    let made = Command::new(PROGRAM)
        .args(["keys", "create", "--name", "operator", "--scopes", scopes])
        .args(crate::support::database::named(database))
        .output()
        .unwrap();
    succeeded(&made).trim().to_owned()
}

#[test]
fn what_is_no_backup_is_refused() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("text"), "not a database, but long enough to be taken for the header of one".repeat(20))
        .unwrap();
    for (file, why) in [("none", "there is no file"), ("text", "not a database")] {
        let output = plumbline("restore", &path(file), &path("p.db"));
        assert!(!output.status.success());
        assert!(String::from_utf8_lossy(&output.stderr).contains(why), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(!path("p.db").exists());
    }
    assert!(!plumbline("backup", &path("copy"), &path("none")).status.success());
    assert!(!path("none").exists(), "looking makes no database");
}

#[tokio::test]
async fn a_check_names_each_damaged_row() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    finished_run(&service, "checked").await;
    let check = || {
        let output = Command::new(PROGRAM).arg("check").args(crate::support::database::named(&database)).output();
        let output = output.unwrap();
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    // While the service runs.
    let (code, told) = check();
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("submissions: 40 rows") && told.contains("nothing is damaged"), "{told}");
    if !crate::support::database::is_postgres() {
        // Keys that are elsewhere are no damage of a backup, and a changed byte is.
        let copy = folder.path().join("copy.db");
        succeeded(&plumbline("backup", &copy, &database));
        let of_copy = || {
            let output = Command::new(PROGRAM).args(["check", "--database"]).arg(&copy).output().unwrap();
            (output.status.code(), String::from_utf8(output.stdout).unwrap())
        };
        let (code, told) = of_copy();
        assert!(
            code == Some(0) && told.contains("NOTE") && told.contains("receipts.key: the key that signed"),
            "{told}"
        );
        // Nor is a key that came after it.
        let later = folder.path().join("copy.db.secrets");
        std::fs::create_dir(&later).unwrap();
        std::fs::write(later.join("receipts.key"), "ab".repeat(32)).unwrap();
        let (code, told) = of_copy();
        assert!(code == Some(0) && told.contains("it is another key than"), "{told}");
        let mut bytes = std::fs::read(&copy).unwrap();
        let name = bytes.windows(7).position(|bytes| bytes == b"checked").unwrap();
        bytes[name] = b'C';
        std::fs::write(&copy, bytes).unwrap();
        let (code, told) = of_copy();
        assert!(code == Some(1) && told.contains("copy.db was changed or cut off"), "{told}");
    }
    drop(service);
    let pool = crate::support::database::pool(&database).await;
    let first =
        async |sql: &'static str| -> String { plumbline::store::db::query_scalar(sql).fetch_one(&pool).await.unwrap() };
    let submission = first("SELECT id FROM submissions ORDER BY task_number LIMIT 1").await;
    let second = first("SELECT id FROM submissions ORDER BY task_number LIMIT 1 OFFSET 1").await;
    let third = first("SELECT id FROM submissions ORDER BY task_number LIMIT 1 OFFSET 2").await;
    let other = first("SELECT id FROM submissions ORDER BY task_number DESC LIMIT 1").await;
    let allow = plumbline::store::db::Each {
        sqlite: "DROP TRIGGER receipts_stand",
        postgres: "DROP TRIGGER receipts_stay ON receipts",
    };
    plumbline::store::db::query(allow).execute(&pool).await.unwrap();
    for damage in [
        "UPDATE submissions SET log = (SELECT log FROM submissions ORDER BY task_number DESC LIMIT 1)
         WHERE id = (SELECT id FROM submissions ORDER BY task_number LIMIT 1)",
        "UPDATE reports SET body = CAST(log_hash AS BLOB) FROM submissions s WHERE s.id = reports.submission_id
         AND s.id = (SELECT id FROM submissions ORDER BY task_number DESC LIMIT 1)",
        "UPDATE reports SET body = (SELECT body FROM reports r JOIN submissions s ON s.id = r.submission_id
                                    ORDER BY task_number LIMIT 1)
         WHERE submission_id = (SELECT id FROM submissions ORDER BY task_number LIMIT 1 OFFSET 1)",
        "UPDATE reports SET grader = 'another'
         WHERE submission_id = (SELECT id FROM submissions ORDER BY task_number LIMIT 1 OFFSET 2)",
        "UPDATE runs SET summary = '{}'",
        "UPDATE receipts SET signature = (SELECT signature FROM receipts WHERE seq = 1) WHERE seq = 3",
    ] {
        let damage = if crate::support::database::is_postgres() {
            damage.replace("CAST(log_hash AS BLOB)", "log_hash::bytea")
        } else {
            damage.to_owned()
        };
        plumbline::store::db::query(sqlx::AssertSqlSafe(damage)).execute(&pool).await.unwrap();
    }
    let (code, told) = check();
    assert_eq!(code, Some(1), "{told}");
    let damaged: Vec<&str> = told.lines().filter(|line| line.starts_with("DAMAGED")).collect();
    assert_eq!(damaged.len(), 6, "{told}");
    for (place, why) in [
        (format!("submissions {submission}: "), "another SHA-256"),
        (format!("reports {other}: "), ""),
        (format!("reports {second}: "), "other scores"),
        (format!("reports {third}: "), "its signed receipt says otherwise: grader"),
        ("runs ".to_owned(), "missing field"),
        ("receipts 3: ".to_owned(), "signature"),
    ] {
        assert!(damaged.iter().any(|line| line.contains(&place) && line.contains(why)), "{place}: {told}");
    }
    assert!(told.contains("6 faults"), "{told}");
    // An export says at which row it stops.
    let refused = plumbline("export", &folder.path().join("lines"), &database);
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && told.contains(&other), "{told}");
}
