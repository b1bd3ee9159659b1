//! What an operator sees, and lets others do: keys that stand in paths, grading without one, probes, a second port,
//! logs.

use std::io::Read as _;
use std::process::{Command, Stdio};

use crate::support::commands::{plumbline, succeeded};
use crate::support::{PROGRAM, Service};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

/// Trainers that can send no header: grading alone is open, or the key stands in the path.
#[tokio::test]
async fn grading_may_be_open_or_keyed_by_path() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let body = json!({ "task": 113, "turns": [{ "events": [] }] });
    let run = json!({ "agent": "a", "suite": "mineceraft" });
    let service = Service::start_as_told(&database, &["--open-grade"]);
    assert_eq!(service.post_json("/v1/grade", &body).await.status, StatusCode::OK);
    let samples = json!({ "query": ["no"], "prompts": [""], "labels": ["113"] });
    assert_eq!(service.post_json("/get_reward", &samples).await.status, StatusCode::OK);
    assert_eq!(service.post_json("/v1/runs", &run).await.status, StatusCode::UNAUTHORIZED);
    assert_eq!(service.post_json("/v1/submissions", &body).await.status, StatusCode::UNAUTHORIZED);
    service.kill();

    let service = Service::start_as_told(&database, &[]);
    assert_eq!(service.post_json("/v1/grade", &body).await.status, StatusCode::UNAUTHORIZED);
    let make = |name: &str, scopes: &str| {
        succeeded(&plumbline(&["keys", "create", "--name", name, "--scopes", scopes], &database))
    };
    let (grading, all) = (make("trainer", "grade"), make("lab", "submit,grade"));
    for path in ["v1/grade", "get_reward", "verify"] {
        let body = match path {
            "get_reward" => samples.clone(),
            "verify" => json!({ "task": 113, "response": { "output": [] } }),
            _ => body.clone(),
        };
        let answer = service.post_json(&format!("/with-key/{grading}/{path}"), &body).await;
        assert_eq!(answer.status, StatusCode::OK, "{path}: {}", answer.text);
    }
    let elsewhere = service.post_json(&format!("/with-key/{grading}/v1/runs"), &run).await;
    assert_eq!(elsewhere.status, StatusCode::NOT_FOUND);
    let wide = service.post_json(&format!("/with-key/{all}/v1/grade"), &body).await;
    assert!(wide.status == StatusCode::UNAUTHORIZED && wide.text.contains("--scopes grade"), "{}", wide.text);
    // As an address with a name becomes it.
    let basic = service.http.post(format!("{}/v1/grade", service.url)).basic_auth("x", Some(&grading)).json(&body);
    assert_eq!(service.send(basic).await.status, StatusCode::OK);
    let id = grading.split('_').nth(1).unwrap();
    succeeded(&plumbline(&["keys", "revoke", id], &database));
    tokio::time::sleep(std::time::Duration::from_millis(700)).await;
    let answer = service.post_json(&format!("/with-key/{grading}/v1/grade"), &body).await;
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED);
    tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    let said = service.said.lock().unwrap().join("\n");
    assert!(said.contains("/with-key/{key}/v1/grade"), "{said}");
    assert!(!said.contains(id) && !said.contains(grading.rsplit('_').next().unwrap()), "{said}");
    service.kill();

    // Where none is needed, what other programs send in its place does no harm, and the answer says so. A key of this
    // service that is none, or no longer, stands for somebody: nothing is done without its owner.
    let service = Service::start(&database, &[]);
    let with = |key: &str| service.http.post(format!("{}/v1/runs", service.url)).bearer_auth(key).json(&run);
    let answer = service.send(with("EMPTY")).await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text);
    assert!(answer.headers["x-plumbline-warning"].to_str().unwrap().contains("unknown"));
    let refused = service.send(service.http.get(format!("{}/v1/nothing", service.url)).bearer_auth("EMPTY")).await;
    assert_eq!(refused.status, StatusCode::NOT_FOUND, "{}", refused.text);
    assert!(refused.headers["x-plumbline-warning"].to_str().unwrap().contains("without a key"));
    for key in [grading.as_str(), "plk_old_key", "plk_typo"] {
        let answer = service.send(with(key)).await;
        assert_eq!(answer.status, StatusCode::UNAUTHORIZED, "{}", answer.text);
        assert!(!answer.headers.contains_key("x-plumbline-warning"), "{:?}", answer.headers);
    }
    for authorization in
        [grading.clone(), format!("Basic {}", base64::Engine::encode(&base64::prelude::BASE64_STANDARD, "plk_typo:"))]
    {
        let sent =
            service.http.post(format!("{}/v1/runs", service.url)).header("authorization", authorization).json(&run);
        assert_eq!(service.send(sent).await.status, StatusCode::UNAUTHORIZED);
    }
    let mine = service.http.get(format!("{}/v1/runs?mine=true", service.url)).bearer_auth("EMPTY");
    let mine = service.send(mine).await;
    assert!(mine.status == StatusCode::BAD_REQUEST && mine.text.contains("the key is unknown"), "{}", mine.text);
}

#[tokio::test]
async fn probes_are_never_limited_and_administration_has_its_own_port() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let arguments = ["--rate-per-address", "2", "--admin-listen", "127.0.0.1:0", "--open"];
    let service = Service::start_as_told(&database, &arguments);
    for _ in 0..20 {
        assert_eq!(service.get("/healthz").await.status, StatusCode::OK);
        assert_eq!(service.get("/readyz").await.status, StatusCode::OK);
    }
    let mut statuses = Vec::new();
    for _ in 0..5 {
        statuses.push(service.get("/v1/limits").await.status);
    }
    assert!(statuses.contains(&StatusCode::TOO_MANY_REQUESTS), "{statuses:?}");
    assert_eq!(service.get("/metrics").await.status, StatusCode::NOT_FOUND);
    let act = service.post_json("/v1/runs/none/board-actions", &json!({ "action": "hide", "reason": "r" })).await;
    assert_eq!(act.status.as_u16() / 100, 4);
    let admin = loop {
        let lines = service.said.lock().unwrap().clone();
        let found = lines.iter().find_map(|line| line.split("administration are at ").nth(1).map(str::to_owned));
        if let Some(found) = found {
            break found;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    };
    let metrics = service.send(service.http.get(format!("{admin}metrics"))).await;
    assert_eq!(metrics.status, StatusCode::OK);
    // What was refused before it reached its route still counts for it.
    assert!(metrics.text.contains("method=\"GET\",route=\"/v1/limits\",status=\"429\""), "{}", metrics.text);
    let is_described = |name: &str| metrics.text.contains(&format!("# HELP {name} "));
    for name in [
        "plumbline_build_info",
        "plumbline_workers_busy",
        "plumbline_database_bytes",
        "plumbline_oldest_submission_not_ended_seconds",
    ] {
        assert!(is_described(name), "{name}: {}", metrics.text);
    }
    let names = metrics.text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next());
    let without: Vec<&str> = names.filter(|name| !is_described(name)).collect();
    assert!(without.is_empty(), "{without:?}");
}

#[tokio::test]
async fn logs_are_json_throughout_with_a_line_a_request() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let address = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut process = Command::new(PROGRAM)
        .args(["serve", "--open", "--log-format", "json", "--listen", &address])
        .args(crate::support::database::named(&database))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let client = plumbline::client::without_tls().build().unwrap();
    let url = format!("http://{address}");
    for _ in 0..2_400 {
        if client.get(format!("{url}/healthz")).send().await.is_ok() {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    let asked = client.get(format!("{url}/v1/tasks?text=needle")).header("x-request-id", "mine");
    assert!(asked.bearer_auth("plk_abc_verysecret").send().await.unwrap().status().is_success());
    assert!(Command::new("kill").arg(process.id().to_string()).status().unwrap().success());
    let mut text = String::new();
    process.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    assert!(process.wait().unwrap().success());
    let read = |line: &str| serde_json::from_str::<Value>(line).unwrap_or_else(|_| panic!("{line}"));
    let lines: Vec<Value> = text.lines().map(read).collect();
    let own = lines.iter().find(|line| line["request_id"] == "mine").unwrap_or_else(|| panic!("{text}"));
    assert_eq!((&own["route"], &own["status"], &own["method"]), (&json!("/v1/tasks"), &json!(200), &json!("GET")));
    assert!(own["duration_ms"].as_f64().unwrap() > 0.0);
    assert!(!text.contains("verysecret") && !text.contains("needle"), "{text}");
    // What goes wrong at the start is JSON too.
    let wrong = Command::new(PROGRAM)
        .args(["serve", "--log-format", "json", "--listen", "nowhere"])
        .args(crate::support::database::named(&database))
        .output()
        .unwrap();
    let line: Value = serde_json::from_slice(&wrong.stderr).unwrap();
    assert!(!wrong.status.success() && line["message"].as_str().unwrap().contains("nowhere"), "{line}");
}

#[tokio::test]
async fn a_head_has_the_headers_of_its_get() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    for path in ["/", "/v1/limits", "/assets/style.css", "/assets/none", "/suites/mineceraft/tasks/none"] {
        for (accept, coding) in [("text/html", "gzip"), ("text/html", "identity"), ("*/*", "gzip"), ("*/*", "identity")]
        {
            let mut seen = Vec::new();
            for method in [Method::GET, Method::HEAD] {
                let request = service.http.request(method, format!("{}{path}", service.url));
                let answer = service.send(request.header("accept", accept).header("accept-encoding", coding)).await;
                let mut headers = answer.headers;
                // A body of unknown length is sent in chunks, and a HEAD has no body.
                for own in ["date", "x-request-id", "ratelimit-remaining", "transfer-encoding"] {
                    headers.remove(own);
                }
                seen.push((answer.status, headers));
            }
            assert_eq!(seen[0], seen[1], "{path} {accept} {coding}");
            assert!(seen[0].1.contains_key("vary"), "{path}: {:?}", seen[0]);
        }
    }
}
