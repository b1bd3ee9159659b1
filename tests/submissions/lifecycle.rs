//! The API over a real socket: runs, submissions, reports, boards.

use std::collections::BTreeMap;

use crate::support::{Service, repository};
use reqwest::StatusCode;
use serde_json::{Value, json};

fn service() -> (tempfile::TempDir, Service) {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    (folder, service)
}

/// The recorded run: per problem its number and, per turn, the cumulative blocks.
fn recorded() -> BTreeMap<u64, Vec<Value>> {
    let text = std::fs::read_to_string(repository("tests/conformance/run.jsonl")).unwrap();
    let mut problems: BTreeMap<u64, Vec<Value>> = BTreeMap::new();
    for line in text.lines() {
        let record: Value = serde_json::from_str(line).unwrap();
        problems.entry(record["run_idx"].as_u64().unwrap()).or_default().push(record["coords"].clone());
    }
    problems
}

/// Events of a turn: cells that are gone are removed, those that are new are placed.
fn events(before: &Value, after: &Value) -> Vec<Value> {
    let cell = |b: &Value| (b["x"].as_i64(), b["y"].as_i64(), b["z"].as_i64());
    let stood: Vec<_> = before.as_array().into_iter().flatten().collect();
    let stands: Vec<_> = after.as_array().unwrap().iter().collect();
    let event = |action: &str, b: &Value| {
        let mut event = b.clone();
        event["action"] = json!(action);
        event
    };
    let gone = stood.iter().filter(|b| !stands.iter().any(|s| cell(s) == cell(b)));
    let new = stands.iter().filter(|b| !stood.contains(b));
    gone.map(|b| event("remove", b)).chain(new.map(|b| event("place", b))).collect()
}

fn assert_close(path: &str, found: &Value, expected: &Value) {
    match expected {
        Value::Object(members) => {
            members.iter().for_each(|(key, value)| assert_close(&format!("{path}/{key}"), &found[key], value));
        }
        Value::Null => assert!(found.is_null(), "{path}: {found}"),
        _ => {
            let (a, b) = (found.as_f64().unwrap(), expected.as_f64().unwrap());
            assert!((a - b).abs() <= 1e-6 * b.abs().max(1.0), "{path}: {a}, expected {b}");
        }
    }
}

#[tokio::test]
async fn the_recorded_run_gives_the_published_board_row() {
    let (_folder, service) = service();
    let run = service.begin_run("synthetic-a", "mineceraft@1").await;
    let problems = recorded();
    let lines: Vec<String> = problems
        .iter()
        .map(|(number, coords)| {
            let before = std::iter::once(&Value::Null).chain(coords);
            let turns: Vec<Value> =
                before.zip(coords).map(|(before, after)| json!({ "events": events(before, after) })).collect();
            json!({ "run": run, "task": number, "turns": turns }).to_string()
        })
        .collect();
    for batch in lines.chunks(200) {
        let answer = service.post("/v1/submissions", "application/x-ndjson", batch.join("\n")).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text);
        assert_eq!(answer.json()["submissions"].as_array().unwrap().len(), batch.len());
    }
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    let board = service.get("/v1/leaderboards/mineceraft@1").await.json();
    let row = &board["rows"][0];
    let expected: Value =
        serde_json::from_slice(&std::fs::read(repository("tests/conformance/run_expected.json")).unwrap()).unwrap();
    assert_eq!((&row["agent"], &row["run"], &row["rank"]), (&json!("synthetic-a"), &json!(run), &json!(1)));
    assert_close("overall", &row["overall"], &expected["problem_level"]["overall"]);
    assert_close("accuracy", &row["accuracy"], &expected["problem_level"]["accuracy"]);
    assert_close("checks", &row["checks"], &expected["check_level"]);
    assert_close("graded", &row["graded"], &expected["graded"]);
    let mut problems = expected["problem_level"].clone();
    problems.as_object_mut().unwrap().remove("overall");
    assert_close("problems", &row["problems"], &problems);
    assert_eq!(row["coverage"], json!({ "pass": 723, "of": 723, "rate": 1.0 }));
}

/// A wall of 5 x 5 as task 113 wants it, in the compact form; `flaw` changes its rows.
fn wall(run: Option<&str>, flaw: impl Fn(&mut Vec<Value>)) -> Value {
    let mut rows = Vec::new();
    for y in 0..5 {
        for i in 0..5 {
            rows.push(json!([0, y, if y % 2 == 0 { i } else { 4 - i }, 0]));
        }
    }
    flaw(&mut rows);
    let mut body = json!({ "task": 113, "turns": [{ "palette": ["stone"], "rows": rows }] });
    if let Some(run) = run {
        body["run"] = json!(run);
    }
    body
}

#[tokio::test]
async fn a_report_tells_what_was_measured_and_where() {
    let (_folder, service) = service();
    let answer = service.post_json("/v1/submissions", &wall(None, |rows| rows[24] = json!([0, 9, 0, 0]))).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text);
    let path = answer.headers["location"].to_str().unwrap().to_owned();
    let ended = service.wait_for(&path, |s| !s["ended_at"].is_null()).await;
    assert_eq!((&ended["state"], &ended["overall"]), (&json!("graded"), &json!(false)));
    assert_eq!(ended["task"], "walls/5x1x5-raise");
    let report = service.get(&format!("{path}/report")).await.json();
    let checks = report["turns"][0]["checks"].as_array().unwrap();
    let floating = checks.iter().find(|c| c["criterion"] == "physical_plausibility").unwrap();
    assert_eq!((&floating["score"], &floating["measured"]), (&json!(0.0), &json!(1)));
    assert_eq!(floating["witnesses"], json!([{ "cell": [0, 9, 0], "why": "floats" }]));
    assert_eq!(report["provenance"]["log_hash"], ended["log_hash"]);
    let log = service.get(&format!("{path}/log")).await;
    assert_eq!(log.json()["palette"], json!(["stone"]));
}

#[tokio::test]
async fn a_run_takes_one_answer_a_task_and_finishes_when_told() {
    let (_folder, service) = service();
    let run = service.begin_run("tester", "mineceraft@1").await;
    let first = service.post_json("/v1/submissions", &wall(Some(&run), |_| {})).await.json();
    let again = service.post_json("/v1/submissions", &wall(Some(&run), |_| {})).await;
    assert_eq!(again.status, StatusCode::ACCEPTED);
    assert_eq!(again.json(), json!({ "id": first["id"], "repeated": true }));
    let other = service.post_json("/v1/submissions", &wall(Some(&run), |rows| drop(rows.pop()))).await;
    assert_eq!(other.faults(409), ["null /task"]);

    let path = format!("/v1/runs/{run}");
    service.post_json(&format!("{path}/finish"), &json!({})).await;
    let finished = service.wait_for(&path, |run| run["state"] == "finished").await;
    assert_eq!((&finished["graded"], &finished["tasks"]), (&json!(1), &json!(723)));
    let summary = &finished["summary"];
    assert_eq!(summary["problem_level"]["overall"]["pass"], 1);
    assert_eq!(summary["problem_level"]["overall"]["of"], 723, "tasks without an answer count as failed");
    assert_eq!(summary["problem_level"]["efficiency"]["of"], 112);
    assert_eq!(summary["graded"]["efficiency"], json!({ "n": 1, "mean": 1.0 }), "means are over what was graded");
    let late = json!({ "run": run, "task": 1, "turns": [{ "events": [] }] });
    assert_eq!(service.post_json("/v1/submissions", &late).await.faults(409), ["null /run"]);
    let page = service.get(&format!("{path}/submissions")).await.json();
    assert_eq!(page["submissions"][0]["id"], first["id"]);
}

#[tokio::test]
async fn ndjson_is_accepted_whole_or_not_at_all() {
    let (_folder, service) = service();
    let run = service.begin_run("tester", "mineceraft").await;
    let good = wall(Some(&run), |_| {}).to_string();
    let body = format!("{good}\n\n{{\"run\":\"{run}\",\"task\":1,\"turns\":[{{\"events\":[{{}}]}}]}}");
    let faults = service.post("/v1/submissions", "application/x-ndjson", body).await.faults(422);
    assert!(faults.iter().all(|fault| fault.starts_with("3 /turns/0/events/0/")), "{faults:?}");
    let other = wall(Some(&run), |rows| drop(rows.pop())).to_string();
    let twice = service.post("/v1/submissions", "application/x-ndjson", format!("{good}\n{other}")).await;
    assert_eq!(twice.faults(409), ["2 /task"]);
    assert!(twice.text.contains("another line of this body"), "{}", twice.text);
    let run = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!((&run["pending"], &run["graded"]), (&json!(0), &json!(0)));
}

#[tokio::test]
async fn documents_of_the_service_are_there() {
    let (_folder, service) = service();
    assert_eq!(service.get("/healthz").await.json()["status"], "ok");
    assert_eq!(service.get("/readyz").await.json()["status"], "ok");
    let limits = service.get("/v1/limits").await.json();
    assert_eq!(limits["body_bytes"], 32 << 20);
    assert_eq!(service.get("/openapi.json").await.json()["openapi"], "3.1.0");
    assert!(service.get("/metrics").await.text.contains("plumbline_submissions_not_ended 0"));
    let docs = service.get("/docs/").await;
    assert!(docs.text.contains("POST /v1/submissions"));
    let suites = service.get("/v1/suites").await.json();
    let ids: Vec<&Value> = suites["suites"].as_array().unwrap().iter().map(|suite| &suite["id"]).collect();
    let known = ["mineceraft", "mineceraft-lite"].map(|name| (1..=4).map(move |version| format!("{name}@{version}")));
    assert_eq!(ids, known.into_iter().flatten().map(Value::from).collect::<Vec<_>>().iter().collect::<Vec<_>>());
    let walls = service.get("/v1/tasks?family=walls&limit=5").await.json();
    assert_eq!((&walls["total"], &walls["next_after"]), (&json!(48), &json!(117)));
    let task = service.get("/v1/tasks/walls/5x1x5-raise").await.json();
    assert_eq!(task["turns"][0]["checks"][0]["fn"], "material.are_blocks_known");
    let board = service.get("/v1/leaderboards/mineceraft-lite").await;
    let known = service.http.get(format!("{}/v1/leaderboards/mineceraft-lite", service.url));
    let known = known.header("if-none-match", &board.headers["etag"]);
    assert_eq!(service.send(known).await.status, StatusCode::NOT_MODIFIED);
    assert!(service.terminate(), "a SIGTERM ends the service well");
}

#[tokio::test]
async fn a_database_of_another_program_is_left_alone() {
    use sqlx::{ConnectOptions as _, Connection as _};
    if crate::support::database::is_postgres() {
        // `durability::postgres` shows the same there.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let foreign = folder.path().join("other.db");
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&foreign).create_if_missing(true);
    let mut connection = options.connect().await.unwrap();
    sqlx::query("CREATE TABLE t (x)").execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    let serve = |database: &std::path::Path| {
        let mut command = std::process::Command::new(crate::support::PROGRAM);
        let output = command
            .args(["serve", "--listen", "127.0.0.1:0"])
            .args(crate::support::database::named(database))
            .output()
            .unwrap();
        assert!(!output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let told = serve(&foreign);
    assert!(told.contains("the database holds tables of another program"), "{told}");
    let told = serve(&folder.path().join("none/p.db"));
    assert!(told.contains("there is no folder"), "{told}");
}

/// A table on one leg, posted for a task without a stress check: its stress field by both methods and in all formats.
#[tokio::test]
async fn stress_fields_of_a_submission() {
    let (_folder, service) = service();
    let place = |x: i32, y: i32, z: i32, material: &str| json!({ "action": "place", "x": x, "y": y, "z": z, "material": material });
    let mut events: Vec<Value> = (0..2).map(|y| place(0, y, 0, "stone")).collect();
    events.extend((0..9).map(|i| place(i % 3 - 1, 2, i / 3 - 1, "oak_planks")));
    let first: Vec<Value> = events.drain(..1).collect();
    let body = json!({ "task": "walls/5x1x5-raise", "turns": [{ "events": first }] });
    let one = service.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned();
    let tasks = service.get("/v1/tasks?limit=1000").await.json();
    let two_turns = tasks["tasks"].as_array().unwrap().iter().find(|task| task["turns"] == 2).unwrap()["id"].clone();
    let body = json!({ "task": two_turns, "turns": [{ "events": first }, { "events": events }] });
    let table = service.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned();

    let field = |query: &str| {
        let path = format!("/v1/submissions/{table}/stress{query}");
        let service = &service;
        async move { service.get(&path).await }
    };
    let fem = field("?method=fem").await.json();
    assert_eq!((fem["turn"].as_u64(), fem["method"].as_str()), (Some(2), Some("fem")));
    let blocks = fem["blocks"].as_array().unwrap();
    assert_eq!(blocks.len(), 11);
    let greatest = blocks.iter().map(|block| block["von_mises_pa"].as_f64().unwrap()).fold(0.0, f64::max);
    assert_eq!(fem["max_von_mises_pa"].as_f64(), Some(greatest));
    assert!(greatest > 9_900.0, "the leg carries eleven blocks of 900 N: {greatest} Pa");
    let corner = blocks.iter().find(|block| block["cell"] == json!([1, 2, 1])).unwrap();
    assert_eq!(corner["material"], "oak_planks");
    assert!(corner["displacement_m"][1].as_f64().unwrap() < 0.0);
    // The published method has an artefact for a plate one block thick, and says so.
    let sph = field("").await.json();
    assert_ne!(sph["max_von_mises_pa"].as_f64(), Some(greatest));
    assert!(sph["cautions"][0].as_str().unwrap().contains("singular moment matrix"));

    let lines = field("?method=fem&format=ndjson").await;
    assert_eq!(lines.kind, "application/x-ndjson");
    let lines: Vec<Value> = lines.text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(&lines, blocks);
    let arrays = field("?method=fem&format=arrays").await.json();
    let names = arrays["palette"].as_array().unwrap();
    for (i, block) in blocks.iter().enumerate() {
        assert_eq!(arrays["cells"][i], block["cell"]);
        assert_eq!(arrays["von_mises_pa"][i], block["von_mises_pa"]);
        assert_eq!(arrays["displacement_m"][i], block["displacement_m"]);
        assert_eq!(names[arrays["materials"][i].as_u64().unwrap() as usize], block["material"]);
    }
    assert_eq!(field("?turn=1").await.json()["blocks"].as_array().unwrap().len(), 1);

    let etag = field("?method=fem").await.headers["etag"].to_str().unwrap().to_owned();
    let path = format!("{}/v1/submissions/{table}/stress?method=fem", service.url);
    let again = service.send(service.http.get(&path).header("if-none-match", &etag)).await;
    assert_eq!((again.status, again.text.as_str()), (StatusCode::NOT_MODIFIED, ""));
    let accepted = service.send(service.http.get(&path).header("accept", "application/x-ndjson")).await;
    assert_eq!(accepted.kind, "application/x-ndjson");

    let strong = etag.trim_start_matches("W/");
    let again = service.send(service.http.get(&path).header("if-none-match", format!("\"other\", {strong}"))).await;
    assert_eq!(again.status, StatusCode::NOT_MODIFIED);

    field("?turn=3").await.faults(404);
    field("?method=guess").await.faults(400);
    service.get("/v1/submissions/none/stress").await.faults(404);
    let single = service.get(&format!("/v1/submissions/{one}/stress?method=fem")).await.json();
    assert_eq!(single["blocks"].as_array().unwrap().len(), 1);
}

/// The bounds of stress fields: blocks, requests at once; and a client that leaves frees its turn.
#[tokio::test]
async fn stress_fields_are_bounded() {
    let (_folder, service) = service();
    let limits = service.get("/v1/limits").await.json();
    let most = i32::try_from(limits["blocks_with_stress"].as_i64().unwrap()).unwrap();
    let slab = |blocks: i32| {
        let rows: Vec<Value> = (0..blocks).map(|i| json!([i % 50, i / 50 % 20 + i % 50 % 2, i / 1_000, 0])).collect();
        json!({ "task": "walls/5x1x5-raise", "turns": [{ "palette": ["stone"], "rows": rows }] })
    };
    let post = |blocks: i32| {
        let (service, body) = (&service, slab(blocks));
        async move { service.post_json("/v1/submissions", &body).await.json()["id"].as_str().unwrap().to_owned() }
    };
    let (large, too_large) = (post(most - 1_000).await, post(most + 1_000).await);
    let path = |id: &str| format!("{}/v1/submissions/{id}/stress", service.url);
    let refused = service.get(&format!("/v1/submissions/{too_large}/stress")).await;
    refused.faults(422);
    assert!(refused.text.contains("too-many-blocks"));
    // All turns and all waiting places are taken at the same time, and two dozen more are sent away at once.
    let places = ["stress_fields_at_once", "stress_fields_waiting"].map(|name| limits[name].as_u64().unwrap());
    let requests: Vec<_> = (0..places.iter().sum::<u64>() + 24)
        .map(|_| tokio::spawn(service.http.get(path(&large)).timeout(std::time::Duration::from_secs(2)).send()))
        .collect();
    let mut sent_away = 0;
    for request in requests {
        // The others run into their time limit, or are done before it on a quick machine.
        let Ok(response) = request.await.unwrap() else { continue };
        if response.status() == StatusCode::SERVICE_UNAVAILABLE {
            assert!(response.headers().contains_key("retry-after"));
            sent_away += 1;
        }
    }
    assert!(sent_away >= 24, "only {sent_away} were sent away");
    // The others left after two seconds; their turns are free again, though all together would take minutes. That they
    // left is seen when their connections are looked at, so who comes at the same moment may have to come again.
    let mut answer = service.get(&format!("/v1/submissions/{large}/stress?method=fem")).await;
    for _ in 0..5 {
        if answer.status == StatusCode::SERVICE_UNAVAILABLE {
            tokio::time::sleep(std::time::Duration::from_secs(1)).await;
            answer = service.get(&format!("/v1/submissions/{large}/stress?method=fem")).await;
        }
    }
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.text.chars().take(200).collect::<String>());
}
