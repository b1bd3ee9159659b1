//! A PostgreSQL database beside the happy path: what is told when it cannot be used, what a node without the secrets
//! does, and a file that moves into it.

use std::process::{Command, Output};

use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::json;

use super::blobs::{LARGE, scattered};
use crate::support::cluster::Cluster;
use crate::support::commands::{refused, succeeded};
use crate::support::{PROGRAM, Service};

fn plumbline(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).output().unwrap()
}

/// Starts the service where it must not start, and gives what it says.
fn serve_refused(url: &str, secrets: &str) -> String {
    let arguments = ["serve", "--listen", "127.0.0.1:0", "--database", url, "--secrets", secrets];
    refused(&Command::new("timeout").arg("30").arg(PROGRAM).args(arguments).output().unwrap())
}

#[tokio::test]
async fn what_is_wrong_with_a_database_is_told_with_the_remedy() {
    let cluster = Cluster::shared();
    let folder = tempfile::tempdir().unwrap();
    let secrets = folder.path().join("secrets").to_str().unwrap().to_owned();
    let nobody_listens = "postgres://plumbline:hush@127.0.0.1:1/grades";
    let told = serve_refused(nobody_listens, &secrets);
    assert!(told.contains("check that the server runs") && !told.contains("hush"), "{told}");
    assert!(serve_refused(&cluster.url("no_such"), &secrets).contains("createdb"));

    cluster.create("foreign");
    let pool = sqlx::PgPool::connect(&cluster.url("foreign")).await.unwrap();
    sqlx::query("CREATE TABLE books (title TEXT)").execute(&pool).await.unwrap();
    assert!(serve_refused(&cluster.url("foreign"), &secrets).contains("tables of another program"));

    cluster.create("locked");
    let pool = sqlx::PgPool::connect(&cluster.url("locked")).await.unwrap();
    for statement in
        ["CREATE ROLE guest LOGIN", "REVOKE ALL ON SCHEMA public FROM PUBLIC", "GRANT USAGE ON SCHEMA public TO guest"]
    {
        sqlx::query(statement).execute(&pool).await.unwrap();
    }
    let as_guest = cluster.url("locked").replace("plumbline@", "guest@");
    let told = serve_refused(&as_guest, &secrets);
    assert!(told.contains("grant it CREATE"), "{told}");

    // Tables that are there, but belong to somebody else.
    cluster.create("theirs");
    succeeded(&plumbline(&["migrate", "--create", "--database", &cluster.url("theirs")]));
    let told = serve_refused(&cluster.url("theirs").replace("plumbline@", "guest@"), &secrets);
    assert!(told.contains("ALL on the tables"), "{told}");

    cluster.create("newer");
    let url = cluster.url("newer");
    succeeded(&plumbline(&["migrate", "--create", "--database", &url]));
    let pool = sqlx::PgPool::connect(&url).await.unwrap();
    let later = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (999, 'later', TRUE, '', 0)";
    sqlx::query(later).execute(&pool).await.unwrap();
    let told = serve_refused(&url, &secrets);
    assert!(told.contains("was written by a newer plumbline (schema 999"), "{told}");

    let told = refused(&plumbline(&["backup", "copy.db", "--database", &url]));
    assert!(told.contains("pg_dump"), "{told}");
    let told = refused(&plumbline(&["keys", "list", "--database", "mysql://lab:hush@x/y"]));
    assert!(told.contains("postgres://") && !told.contains("hush"), "{told}");
}

#[test]
fn an_old_server_is_refused_with_the_version_that_serves() {
    let cluster = Cluster::too_old();
    let folder = tempfile::tempdir().unwrap();
    let told = serve_refused(&cluster.url("postgres"), folder.path().join("secrets").to_str().unwrap());
    assert!(told.contains("is PostgreSQL 14.23") && told.contains("needs 15 or newer"), "{told}");
}

#[tokio::test]
async fn a_node_without_the_secrets_serves_what_needs_none() {
    let cluster = Cluster::shared();
    cluster.create("secrets");
    let folder = tempfile::tempdir().unwrap();
    let url = cluster.url("secrets");
    let node = |role: &str, secrets: &str| {
        let mut command = Command::new(PROGRAM);
        command.args([role, "--database", &url, "--secrets"]).arg(folder.path().join(secrets));
        if role == "serve" {
            command.arg("--open");
        }
        command
    };
    let whole = Service::launch(node("serve", "ours"));
    let lacking = Service::launch(node("serve", "none"));
    assert_eq!(whole.get("/readyz").await.json().get("lacks"), None);
    assert_eq!(lacking.get("/readyz").await.json()["lacks"], json!(["secrets"]));
    // It takes submissions, which the other grades, and tells the same key.
    let body = json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0]] }] });
    let accepted = lacking.post_json("/v1/submissions", &body).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
    let path = format!("/v1/submissions/{}", accepted.json()["id"].as_str().unwrap());
    lacking.wait_for(&path, |one| one["state"] == "graded").await;
    let key = "/.well-known/plumbline-receipts.json";
    assert_eq!(lacking.get(key).await.text, whole.get(key).await.text);
    assert_eq!(lacking.get(&format!("{path}/receipt")).await.status, StatusCode::OK);

    // A new database under the key of this one would be a second history.
    cluster.create("empty");
    let empty = cluster.url("empty");
    let told = serve_refused(&empty, folder.path().join("ours").to_str().unwrap());
    assert!(told.contains("is missing or empty") && told.contains("name the one that they belong to"), "{told}");

    // Another key than the others': no node signs with two.
    std::fs::create_dir(folder.path().join("other")).unwrap();
    std::fs::write(folder.path().join("other/receipts.key"), "11".repeat(32)).unwrap();
    let told = serve_refused(&url, folder.path().join("other").to_str().unwrap());
    assert!(told.contains("Give this node the folder of the others"), "{told}");
    let with_new_key = || {
        let mut command = node("serve", "other");
        command.arg("--new-receipt-key");
        command
    };
    // The others would go on signing with the old key.
    let told = refused(&with_new_key().output().unwrap());
    assert!(told.contains("other nodes are running") && told.contains("stop all of them"), "{told}");
    let before = whole.get(key).await.json()["public_key"].clone();
    whole.kill();
    lacking.kill();
    let replaced = Service::launch(with_new_key());
    assert_ne!(replaced.get(key).await.json()["public_key"], before);
    let log = replaced.get("/v1/receipts").await.json();
    assert_eq!(log["receipts"].as_array().unwrap().len(), 2, "{log}");
}

#[tokio::test]
async fn a_node_that_only_grades_needs_no_database() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--grade-only"]).current_dir(folder.path());
    let node = Service::launch(command);
    let task = embedded::latest().unwrap().tasks[0].clone();
    let mut body = crate::support::good_build(&task, false, None);
    let graded = node.post_json("/v1/grade", &body).await;
    assert_eq!((graded.status, graded.json()["overall"].as_bool()), (StatusCode::OK, Some(true)), "{}", graded.text);
    // It knows no key, so one of the service that it stands beside is as good as none.
    let keyed = node.http.post(format!("{}/v1/grade", node.url)).bearer_auth("plk_000000000000_0").json(&body);
    assert_eq!(node.send(keyed).await.status, StatusCode::OK);
    body["task"] = json!("no-such");
    assert_eq!(node.post_json("/v1/grade", &body).await.faults(422), ["null /task"]);
    for path in ["/v1/tasks", "/v1/blocks", "/v1/agent-guide"] {
        assert_eq!(node.get(path).await.status, StatusCode::OK, "{path}");
    }
    assert_eq!(node.get("/readyz").await.status, StatusCode::OK);
    for path in ["/v1/runs", "/v1/leaderboards/mineceraft", "/boards/mineceraft", "/nosuch"] {
        let told = node.get(path).await;
        assert_eq!(told.status, StatusCode::NOT_FOUND, "{path}");
        assert!(told.text.contains("--grade-only"), "{path}: {}", told.text);
    }
    let document = node.get("/openapi.json").await.json();
    assert!(document["paths"].get("/v1/grade").is_some() && document["paths"].get("/v1/runs").is_none());
    assert!(node.terminate());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "it leaves nothing behind");
}

#[tokio::test]
async fn a_file_moves_into_an_empty_database_and_answers_as_before() {
    let cluster = Cluster::shared();
    cluster.create("moved");
    let (folder, url) = (tempfile::tempdir().unwrap(), cluster.url("moved"));
    let file = folder.path().join("p.db").to_str().unwrap().to_owned();
    let serve = |database: &str| {
        let mut command = Command::new(PROGRAM);
        command.args(["serve", "--open", "--database", database, "--secrets"]).arg(folder.path().join("p.db.secrets"));
        Service::launch(command)
    };
    // A file notes the place of its large logs, and so does the database then.
    let blobs = folder.path().join("blobs");
    let place = format!("file://{}", blobs.display());
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--open", "--database", &file, "--blobs", &place]);
    let before = Service::launch(command);
    let busy = refused(&plumbline(&["migrate", "--from", &file, "--to", &url]));
    assert!(busy.contains("stop it first"), "{busy}");
    assert_eq!(before.get("/v1/runs/a%00b").await.faults(400), [""; 0]);
    let run = before.finished_run("moves", 3).await;
    let id = before.post_json("/v1/submissions", &scattered(LARGE, 1)).await.json()["id"].as_str().unwrap().to_owned();
    before.wait_for(&format!("/v1/submissions/{id}"), |one| one["state"] == "graded").await;
    let asked = [
        format!("/v1/runs/{run}"),
        format!("/v1/runs/{run}/submissions"),
        format!("/v1/submissions/{id}/report"),
        format!("/v1/submissions/{id}/log"),
        format!("/v1/submissions/{id}/receipt"),
        "/v1/leaderboards/mineceraft-lite".to_owned(),
        "/v1/events?after=0&submission=".to_owned() + &id,
    ];
    let answers = async |service: &Service| {
        let mut all = Vec::new();
        for path in &asked {
            all.push(service.get(path).await.text);
        }
        all
    };
    let expected = answers(&before).await;
    let rehearsed = succeeded(&plumbline(&["migrate", "--from", &file, "--to", &url, "--dry-run"]));
    assert!(rehearsed.contains("submissions: 26 rows") && rehearsed.contains("nothing was moved"), "{rehearsed}");
    assert!(before.terminate());
    let away = folder.path().join("away");
    std::fs::rename(&blobs, &away).unwrap();
    let told = plumbline(&["migrate", "--from", &file, "--to", &url, "--dry-run"]);
    let (warned, told) = (String::from_utf8_lossy(&told.stderr).into_owned(), succeeded(&told));
    assert!(told.contains(&format!("stay in {place}")) && warned.contains("is it mounted?"), "{told}\n{warned}");
    std::fs::rename(&away, &blobs).unwrap();
    let moved = succeeded(&plumbline(&["migrate", "--from", &file, "--to", &url]));
    assert!(moved.contains("submissions: 26 rows, the same in both"), "{moved}");
    assert!(moved.contains(&format!("move {file} away now")), "{moved}");
    let after = serve(&url);
    assert_eq!(answers(&after).await, expected);
    // New rows come after the moved ones.
    let next = after.finished_run("comes after", 0).await;
    let board = after.get("/v1/leaderboards/mineceraft-lite").await.json();
    assert_eq!(board["rows"][0]["run"], next.as_str(), "{board}");
    assert!(after.terminate());
    // What is exported there comes into a file as it was.
    let (lines, copy) = (folder.path().join("lines"), folder.path().join("copy.db"));
    let (lines, copy) = (lines.to_str().unwrap(), copy.to_str().unwrap());
    succeeded(&plumbline(&["export", lines, "--database", &url]));
    succeeded(&plumbline(&["migrate", "--create", "--database", copy]));
    let imported = succeeded(&plumbline(&["import", lines, "--database", copy]));
    assert!(imported.contains("submissions: 51"), "{imported}");
    let copied = serve(copy);
    assert_eq!(copied.get("/v1/leaderboards/mineceraft-lite").await.json()["rows"], board["rows"]);
    let again = refused(&plumbline(&["migrate", "--from", &file, "--to", &url]));
    assert!(again.contains("not empty"), "{again}");
}
