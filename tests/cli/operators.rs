//! An operator's second day: commands that say what they touch, files of other versions, keys, quotas, logs, a second
//! port.

use std::path::Path;
use std::process::Command;

use crate::support::commands::{plumbline, refused, succeeded, told};
use crate::support::{PROGRAM, Service, repository};
use reqwest::StatusCode;
use serde_json::json;

/// A database as the migrations up to one make it.
async fn database_of_schema(file: &Path, last: i64) {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(repository("migrations/sqlite")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name[..4].parse::<i64>().unwrap() <= last {
            std::fs::copy(&path, folder.path().join(name)).unwrap();
        }
    }
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(file).create_if_missing(true);
    let pool = sqlx::SqlitePool::connect_with(options).await.unwrap();
    sqlx::migrate::Migrator::new(folder.path()).await.unwrap().run(&pool).await.unwrap();
    pool.close().await;
}

#[tokio::test]
async fn only_serve_and_migrate_change_a_schema_and_nothing_else_makes_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (old, none) = (folder.path().join("old.db"), folder.path().join("none.db"));
    for command in [
        &["keys", "list"][..],
        &["keys", "create", "--name", "a"],
        &["quota", "show", "--name", "a"],
        &["epochs", "list"],
    ] {
        let said = refused(&plumbline(command, &none));
        assert!(said.contains("there is no database") && said.contains("none.db"), "{said}");
    }
    assert!(!none.exists());

    database_of_schema(&old, 11).await;
    let before = std::fs::read(&old).unwrap();
    let said = refused(&plumbline(&["keys", "list"], &old));
    assert!(said.contains("has schema 11") && said.contains("plumbline migrate"), "{said}");
    let said = succeeded(&plumbline(&["migrate", "--dry-run"], &old));
    assert!(said.contains("0012") && said.contains("nothing was changed"), "{said}");
    assert_eq!(std::fs::read(&old).unwrap(), before, "looking changes nothing");
    let said = succeeded(&plumbline(&["migrate"], &old));
    assert!(said.contains("old.db.schema-11"), "{said}");
    assert!(folder.path().join("old.db.schema-11").exists());
    assert!(succeeded(&plumbline(&["migrate"], &old)).contains("nothing to do"));
    succeeded(&plumbline(&["keys", "list"], &old));
    // The same file serves.
    drop(Service::start(&old, &[]));

    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&old);
    let mut newer = sqlx::ConnectOptions::connect(&options).await.unwrap();
    sqlx::query("INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) VALUES (9999, 'later', 1, x'00', 0)")
        .execute(&mut newer)
        .await
        .unwrap();
    sqlx::Connection::close(newer).await.unwrap();
    for command in [&["keys", "list"][..], &["migrate"], &["serve", "--listen", "127.0.0.1:0"]] {
        let said = refused(&plumbline(command, &old));
        assert!(said.contains("written by a newer plumbline (schema 9999"), "{said}");
    }
    assert!(succeeded(&plumbline(&["migrate", "--create"], &none)).contains("created with schema"));
}

#[tokio::test]
async fn keys_are_rotated_revoked_whole_and_named_plainly() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &[]);
    let made = plumbline(&["keys", "create", "--name", "lab", "--scopes", "submit", "--expires", "12h"], &database);
    let key = succeeded(&made);
    assert!(told(&made).contains("p.db"), "a command names its file");
    for (name, why) in [("a\nb", "control characters"), (" lab", "leading or trailing spaces"), ("", "1 to 100")] {
        assert!(refused(&plumbline(&["keys", "create", "--name", name], &database)).contains(why));
    }
    for (time, why) in [("0h", "out of range"), ("1w", "neither days")] {
        assert!(refused(&plumbline(&["keys", "create", "--name", "x", "--expires", time], &database)).contains(why));
    }
    let id = key.split('_').nth(1).unwrap();
    let next = succeeded(&plumbline(&["keys", "rotate", id, "--overlap", "1"], &database));
    let post = |key: String| {
        let run = json!({ "agent": "a", "suite": "mineceraft" });
        service.send(service.http.post(format!("{}/v1/runs", service.url)).bearer_auth(key).json(&run))
    };
    assert_eq!(post(key.clone()).await.status, StatusCode::CREATED, "for an hour both work");
    assert_eq!(post(next.clone()).await.status, StatusCode::CREATED);
    // For the overlap there may be three, and no more.
    succeeded(&plumbline(&["keys", "rotate", id, "--overlap", "1"], &database));
    assert!(refused(&plumbline(&["keys", "rotate", id], &database)).contains("2 live keys"));
    // The end of the first came nearer with its replacement; a further one lives as long as the first was to live.
    succeeded(&plumbline(&["keys", "create", "--name", "other", "--expires", "90d"], &database));
    let list = succeeded(&plumbline(&["keys", "list"], &database));
    let other = list.lines().find(|line| line.contains("other")).unwrap().split('|').nth(1).unwrap().trim().to_owned();
    let first = told(&plumbline(&["keys", "rotate", &other], &database));
    let second = told(&plumbline(&["keys", "rotate", &other], &database));
    let day = |text: &str| text.split("works until ").nth(1).unwrap()[..10].to_owned();
    assert_eq!(day(&first), day(&second), "{first} {second}");
    assert!(!first.contains("was replaced before") && second.contains("was replaced before"), "{first} {second}");
    let endless = succeeded(&plumbline(&["keys", "create", "--name", "third"], &database));
    let endless = endless.split('_').nth(1).unwrap();
    for _ in 0..2 {
        let told = told(&plumbline(&["keys", "rotate", endless], &database));
        assert!(told.contains("shown only once;"), "it has no end: {told}");
    }
    // A whole key is taken, and its secret never told again.
    let said = told(&plumbline(&["keys", "revoke", &next], &database));
    assert!(said.contains("revoked") && !said.contains(next.rsplit('_').next().unwrap()), "{said}");
    tokio::time::sleep(std::time::Duration::from_millis(700)).await;
    assert_eq!(post(next).await.status, StatusCode::UNAUTHORIZED);
    let secret = key.rsplit('_').next().unwrap();
    assert!(!refused(&plumbline(&["keys", "revoke", secret], &database)).contains(secret));

    // All keys of an owner and of its members end together.
    succeeded(&plumbline(&["keys", "create", "--name", "lab", "--member", "ann", "--role", "manager"], &database));
    let said = succeeded(&plumbline(&["keys", "revoke", "--name", "lab"], &database));
    assert!(said.starts_with("revoked 3 keys of lab: "), "{said}");
    let list = succeeded(&plumbline(&["keys", "list"], &database));
    assert!(list.lines().filter(|line| line.contains("| lab ")).all(|line| line.contains("revoked ")), "{list}");
    assert!(list.lines().any(|line| line.contains("| third ") && line.contains("live")), "others keep theirs: {list}");
    assert!(refused(&plumbline(&["keys", "revoke", "--name", "lab"], &database)).contains("has no live key"));
    let both = plumbline(&["keys", "revoke", endless, "--name", "third"], &database);
    assert!(refused(&both).contains("cannot be used with"));
}

#[tokio::test]
async fn a_first_grant_begins_to_count_then_and_can_be_lifted() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = Service::start_as_told(&database, &[]);
    let key = succeeded(&plumbline(&["keys", "create", "--name", "lab"], &database));
    let mut headers = reqwest::header::HeaderMap::new();
    headers.insert("authorization", format!("Bearer {key}").parse().unwrap());
    service.http = plumbline::client::without_tls().default_headers(headers).build().unwrap();
    let submit = async |x: i32| {
        let log = json!({ "task": 113, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] });
        service.post_json("/v1/submissions", &log).await.status
    };
    for x in 0..5 {
        assert_eq!(submit(x).await, StatusCode::ACCEPTED);
    }
    service.wait_for("/v1/quota", |quota| quota["charged"] == 5).await;
    let grant = |name: &str, count: &str, more: &[&str]| {
        let arguments =
            [&["quota", "grant", "--name", name, "--reason", "trial", "--submissions", count], more].concat();
        plumbline(&arguments, &database)
    };
    assert!(refused(&grant("lba", "3", &[])).contains("did you mean lab?"));
    succeeded(&grant("somebody new", "3", &["--new-owner"]));
    assert!(succeeded(&grant("lab", "3", &[])).contains("granted 3, left 3"));
    for x in 5..8 {
        assert_eq!(submit(x).await, StatusCode::ACCEPTED);
    }
    assert_eq!(submit(9).await, StatusCode::FORBIDDEN);
    let taken = succeeded(&grant("lab", "-2", &[]));
    assert!(taken.contains("left 0") && taken.contains("lab owes 2 submissions"), "never below: {taken}");
    assert_eq!(service.get("/v1/quota").await.json()["left"], 0);
    let lift = || plumbline(&["quota", "lift", "--name", "lab", "--reason", "a partner"], &database);
    assert!(succeeded(&lift()).contains("granted no limit"));
    assert_eq!(submit(9).await, StatusCode::ACCEPTED);
    assert!(refused(&lift()).contains("already has no limit"));
}

#[tokio::test]
async fn a_new_receipt_key_is_told_and_the_log_verifies_under_both() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let submit = async |service: &Service, x: i32| {
        let log = json!({ "task": 113, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] });
        let id = service.post_json("/v1/submissions", &log).await.json()["id"].as_str().unwrap().to_owned();
        service.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] == "graded").await;
    };
    let key_of = async |service: &Service| {
        service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].as_str().unwrap().to_owned()
    };
    let service = Service::start(&path("p.db"), &[]);
    submit(&service, 0).await;
    let old = key_of(&service).await;
    succeeded(&plumbline(&["backup", path("copy.db").to_str().unwrap()], &path("p.db")));
    service.kill();
    let dry = succeeded(&plumbline(&["restore", "--dry-run", path("copy.db").to_str().unwrap()], &path("r.db")));
    assert!(dry.contains("without keys") && dry.contains("r.db") && dry.contains("1 submission,"), "{dry}");
    assert!(!path("r.db").exists());
    let done = succeeded(&plumbline(&["restore", path("copy.db").to_str().unwrap()], &path("r.db")));
    assert!(done.contains("shorter than witnesses may have seen it"), "{done}");
    // Without the key the service does not begin another history by itself.
    let said = refused(&plumbline(&["serve", "--listen", "127.0.0.1:0"], &path("r.db")));
    assert!(said.contains(&old) && said.contains("--secrets") && said.contains("--new-receipt-key"), "{said}");
    assert!(!path("r.db.secrets/receipts.key").exists());
    let restored = Service::start(&path("r.db"), &["--new-receipt-key"]);
    let new = key_of(&restored).await;
    assert_ne!(new, old);
    submit(&restored, 1).await;
    let log = restored.get("/v1/receipts").await;
    assert_eq!(log.json()["receipts"][1]["receipt"]["key_change"]["before"], json!(old), "{}", log.text);
    tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    let said = restored.said.lock().unwrap().join("\n");
    assert!(said.contains("a new key from now on") && said.contains(&old), "{said}");
    std::fs::write(path("log.json"), &log.text).unwrap();
    let verify = |keys: &[&str]| {
        let keys = keys.iter().flat_map(|key| ["--key", key]);
        Command::new(PROGRAM).arg("verify-receipt").arg(path("log.json")).args(keys).output().unwrap()
    };
    assert!(succeeded(&verify(&[&old, &new])).contains("the key changed"));
    assert!(refused(&verify(&[&new])).contains("which you do not trust"));
    // A forged copy of a page is found whichever file comes first.
    let mut forged = log.json();
    forged["receipts"][0]["receipt"]["task"] = json!("another");
    std::fs::write(path("forged.json"), forged.to_string()).unwrap();
    for order in [["forged.json", "log.json"], ["log.json", "forged.json"]] {
        let mut both = Command::new(PROGRAM);
        both.arg("verify-receipt").args(order.map(path)).args(["--key", &old, "--key", &new]);
        assert!(refused(&both.output().unwrap()).contains("BROKEN  receipt 1"), "{order:?}");
    }
    // Started again it says nothing more.
    restored.kill();
    let again = Service::start(&path("r.db"), &[]);
    assert_eq!(again.get("/v1/receipts").await.json()["receipts"].as_array().unwrap().len(), 3);
    again.kill();
    // Its keys are still there when an earlier copy takes its place.
    for file in ["r.db", "r.db-wal", "r.db-shm"] {
        let _ = std::fs::remove_file(path(file));
    }
    let dry = succeeded(&plumbline(&["restore", "--dry-run", path("copy.db").to_str().unwrap()], &path("r.db")));
    assert!(dry.contains("r.db.secrets stay as they are"), "{dry}");
}

#[tokio::test]
async fn a_second_process_on_a_file_is_noticed_while_the_first_lives() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let notice = async |service: &Service| {
        // The notices come after the address, for which the start waits.
        tokio::time::sleep(std::time::Duration::from_millis(200)).await;
        service.said.lock().unwrap().iter().any(|line| line.contains("another process serves"))
    };
    let first = Service::start(&database, &[]);
    let second = Service::start(&database, &[]);
    assert!(!notice(&first).await && notice(&second).await);
    second.kill();
    // A new receipt key beside a process that signs with the old one would break the log.
    let body = json!({ "task": 113, "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }] });
    let id = first.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned();
    first.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] == "graded").await;
    let (key, aside) = (folder.path().join("p.db.secrets/receipts.key"), folder.path().join("aside.key"));
    std::fs::rename(&key, &aside).unwrap();
    let said = refused(&plumbline(&["serve", "--listen", "127.0.0.1:0"], &database));
    assert!(said.contains("does not hold the key"), "{said}");
    let said = refused(&plumbline(&["serve", "--listen", "127.0.0.1:0", "--new-receipt-key"], &database));
    assert!(said.contains("another process that serves the file is running"), "{said}");
    std::fs::rename(&aside, &key).unwrap();
    first.kill();
    let alone = Service::start(&database, &[]);
    assert!(!notice(&alone).await, "processes that were killed are no more");
}

#[test]
fn switches_in_the_environment_may_be_numbers_and_words() {
    let start = |value: &str| {
        // Nobody can listen there, so the program ends once it has read its arguments.
        Command::new(PROGRAM).args(["serve", "--listen", "nowhere"]).env("PLUMBLINE_OPEN", value).output().unwrap()
    };
    for value in ["1", "true", "yes", "0", "false"] {
        assert!(told(&start(value)).contains("cannot listen"), "{value}: {}", told(&start(value)));
    }
    let wrong = told(&start("maybe"));
    assert!(wrong.contains("--open") && wrong.contains("PLUMBLINE_OPEN is set in the environment"), "{wrong}");
    // As Compose sets a variable without a value.
    assert!(told(&start("")).contains("cannot listen"), "{}", told(&start("")));
}

#[test]
fn readers_that_have_seen_enough_are_left_in_peace() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("many.js");
    std::fs::write(&script, "for (let i = 0; i < 20000; i++) skills.placeBlock(bot, 'stone', i, 0, 0)").unwrap();
    for command in ["openapi", "tasks list", "tasks schema", &format!("replay {}", script.display())] {
        let shell = format!("\"$0\" {command} | head -1");
        let output = Command::new("bash").args(["-c", &shell, PROGRAM]).output().unwrap();
        assert!(output.stderr.is_empty(), "{command}: {}", told(&output));
        assert!(!output.stdout.is_empty(), "{command}");
    }
}

#[tokio::test]
async fn a_filter_of_the_log_that_hides_errors_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for (filter, format, told) in [
        ("inof", "text", "RUST_LOG hides errors of the service"),
        ("plumbline=nothing", "text", "RUST_LOG is not a valid filter"),
        ("inof", "json", r#"{"level":"WARN","message":"RUST_LOG hides errors of the service"#),
    ] {
        let mut command = Command::new(PROGRAM);
        command.env("RUST_LOG", filter);
        let database = folder.path().join("p.db");
        if format == "json" {
            // It prints no address to wait for.
            let mut process = command
                .args(["serve", "--listen", "127.0.0.1:0", "--log-format", format, "--database"])
                .arg(&database)
                .stderr(std::process::Stdio::piped())
                .spawn()
                .unwrap();
            let mut first = String::new();
            std::io::BufRead::read_line(&mut std::io::BufReader::new(process.stderr.take().unwrap()), &mut first)
                .unwrap();
            process.kill().unwrap();
            process.wait().unwrap();
            assert!(first.starts_with(told), "{first}");
            serde_json::from_str::<serde_json::Value>(&first).unwrap();
        } else {
            let service = Service::start_by(command, &database, &["--open"]);
            let said = service.said.lock().unwrap().join("\n");
            assert!(said.contains(told), "{filter}: {said}");
        }
    }
}

#[tokio::test]
async fn a_key_in_a_cookie_is_for_https_behind_a_proxy() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &["--behind-proxy"]);
    let admin = succeeded(&plumbline(&["keys", "create", "--name", "admin", "--scopes", "admin"], &database));
    let signed_in = async |headers: &[(&str, &str)]| {
        let http = plumbline::client::without_tls().redirect(reqwest::redirect::Policy::none()).build().unwrap();
        let mut request = http
            .post(format!("{}/moderation/sign-in", service.url))
            .header("content-type", "application/x-www-form-urlencoded")
            .body(format!("key={admin}"));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let answer = service.send(request).await;
        answer.headers["set-cookie"].to_str().unwrap().to_owned()
    };
    let client = ("x-forwarded-for", "192.0.2.1");
    assert!(signed_in(&[client]).await.contains("; Secure"));
    assert!(signed_in(&[client, ("x-forwarded-proto", "https")]).await.contains("; Secure"));
    assert!(!signed_in(&[client, ("x-forwarded-proto", "http")]).await.contains("; Secure"));
    // Who reaches the service without the proxy, as on an admin listener, has no https.
    assert!(!signed_in(&[]).await.contains("; Secure"));
}
