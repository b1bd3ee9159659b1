//! The real program for tests: started as a process on a free port with a database file of its own.

pub mod audit;
pub mod beacon;
pub mod bucket;
pub mod cluster;
pub mod commands;
pub mod database;
pub mod disk;
pub mod endpoint;
pub mod epoch;
pub mod line;
pub mod nodes;
pub mod pages;
pub mod place;
pub mod tampering;

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use plumbline::client::without_tls;
use plumbline_engine::builders::build;
use plumbline_engine::tasks::{Task, embedded};
use reqwest::{Client, RequestBuilder, StatusCode};
use serde_json::{Value, json};

/// The program.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_plumbline");

/// A file of the repository.
pub fn repository(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A running service. Dropping it kills it.
pub struct Service {
    process: Child,
    pub url: String,
    pub http: Client,
    /// What it wrote to its standard error, line by line.
    pub said: Arc<Mutex<Vec<String>>>,
}

/// An answer, read to its end.
#[derive(Debug)]
pub struct Answer {
    pub status: StatusCode,
    pub kind: String,
    pub headers: reqwest::header::HeaderMap,
    pub text: String,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.text).unwrap_or_else(|_| panic!("not JSON: {}", self.text))
    }

    /// Asserts that this is a problem of a status, and gives its faults as `line pointer`.
    pub fn faults(&self, status: u16) -> Vec<String> {
        assert_eq!(self.status.as_u16(), status, "{}", self.text);
        assert_eq!(self.kind, "application/problem+json", "{}", self.text);
        let problem = self.json();
        for member in ["type", "title", "detail"] {
            assert!(problem[member].is_string(), "{}", self.text);
        }
        assert_eq!(problem["status"], status);
        let fault = |fault: &Value| format!("{} {}", fault["line"], fault["pointer"].as_str().unwrap());
        problem["faults"].as_array().map(|faults| faults.iter().map(fault).collect()).unwrap_or_default()
    }
}

/// A submission of the builders' own build, or of nothing, for a task.
pub fn good_build(task: &Task, is_empty: bool, run: Option<&str>) -> Value {
    let log: Value = serde_json::from_slice(&build(task).unwrap().canonical_json()).unwrap();
    let turn =
        |rows: &Value| json!({ "palette": log["palette"], "rows": if is_empty { json!([]) } else { rows.clone() } });
    let turns: Vec<Value> = log["turns"].as_array().unwrap().iter().map(turn).collect();
    let mut body = json!({ "task": task.number, "turns": turns });
    if let Some(run) = run {
        body["run"] = run.into();
    }
    body
}

impl Service {
    /// Starts the program on a database file, open to everybody.
    pub fn start(database: &std::path::Path, arguments: &[&str]) -> Self {
        Self::start_as_told(database, &[arguments, &["--open"]].concat())
    }

    /// The same, with these arguments alone.
    pub fn start_as_told(database: &std::path::Path, arguments: &[&str]) -> Self {
        Self::start_by(Command::new(PROGRAM), database, arguments)
    }

    /// The same, by a command that runs the program.
    pub fn start_by(mut command: Command, path: &std::path::Path, arguments: &[&str]) -> Self {
        command.arg("serve").args(database::named(path)).args(arguments);
        Self::launch(command)
    }

    /// Starts a command that runs the program as a service, on a free port.
    pub fn launch(mut command: Command) -> Self {
        let mut process = command.args(["--listen", "127.0.0.1:0"]).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let mut seen = Vec::new();
        let url = loop {
            let line = lines.next().unwrap_or_else(|| panic!("the service did not start: {seen:#?}")).unwrap();
            if let Some(rest) = line.strip_prefix("plumbline is at ") {
                break rest.split('/').take(3).collect::<Vec<_>>().join("/");
            }
            seen.push(line);
        };
        // Whatever it says later must be read, or it would block.
        let said = Arc::new(Mutex::new(seen));
        let kept = Arc::clone(&said);
        std::thread::spawn(move || lines.for_each(|line| kept.lock().unwrap().extend(line)));
        // The service ends connections that wait for 10 s, also while a request is on its way to it.
        let http = without_tls().pool_idle_timeout(Duration::from_secs(4)).build().unwrap();
        Self { process, url, http, said }
    }

    /// Sends this key with every request from now on, or none.
    pub fn use_key(&mut self, key: Option<&str>) {
        let value = key.map(|key| format!("Bearer {key}").parse().unwrap());
        let headers = value.map(|value| (reqwest::header::AUTHORIZATION, value)).into_iter().collect();
        self.http = without_tls().pool_idle_timeout(Duration::from_secs(4)).default_headers(headers).build().unwrap();
    }

    pub async fn send(&self, request: RequestBuilder) -> Answer {
        let response = request.send().await.unwrap();
        let (status, headers) = (response.status(), response.headers().clone());
        let kind = headers.get("content-type").map(|kind| kind.to_str().unwrap().to_owned()).unwrap_or_default();
        Answer { status, kind, headers, text: response.text().await.unwrap() }
    }

    pub async fn get(&self, path: &str) -> Answer {
        self.send(self.http.get(format!("{}{path}", self.url))).await
    }

    pub async fn post(&self, path: &str, kind: &str, body: impl Into<reqwest::Body>) -> Answer {
        self.send(self.http.post(format!("{}{path}", self.url)).header("content-type", kind).body(body)).await
    }

    pub async fn post_json(&self, path: &str, body: &Value) -> Answer {
        self.post(path, "application/json", body.to_string()).await
    }

    /// Begins a run and gives its id.
    pub async fn begin_run(&self, agent: &str, suite: &str) -> String {
        let run = self.post_json("/v1/runs", &json!({ "agent": agent, "suite": suite })).await;
        assert_eq!(run.status, StatusCode::CREATED, "{}", run.text);
        run.json()["id"].as_str().unwrap().to_owned()
    }

    /// Posts a run of the Lite suite that solves all tasks but the first so many; gives its id.
    pub async fn finished_run(&self, agent: &str, unsolved: usize) -> String {
        let run = self.begin_run(agent, "mineceraft-lite").await;
        self.answer_run(&run, unsolved).await;
        run
    }

    /// Answers all tasks of a run of the Lite suite, all but the first so many well, and waits for its end.
    pub async fn answer_run(&self, run: &str, unsolved: usize) {
        let suite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
        let line = |(i, task)| good_build(task, i < unsolved, Some(run)).to_string();
        let lines: Vec<String> = suite.tasks.iter().enumerate().map(line).collect();
        let accepted = self.post("/v1/submissions", "application/x-ndjson", lines.join("\n")).await;
        assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
        self.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    }

    /// Looks at a document until it is as wanted; fails after five minutes.
    pub async fn wait_for(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..3_000 {
            let found = self.get(path).await.json();
            if wanted(&found) {
                return found;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        panic!("{path} did not become as wanted: {}", self.get(path).await.text);
    }

    /// Returns the number of submissions that are neither graded nor failed, or nothing while the database
    /// is too busy to tell.
    pub async fn not_ended(&self) -> Option<usize> {
        let metrics = self.get("/metrics").await;
        let left = metrics.text.lines().find_map(|line| line.strip_prefix("plumbline_submissions_not_ended "));
        let said = self.said.lock().unwrap();
        let why = || panic!("{}; at last it said {:#?}", metrics.text, &said[said.len().saturating_sub(20)..]);
        left.unwrap_or_else(why).parse().ok()
    }

    /// Waits until nothing waits, and the service says that it is ready; fails after ten minutes.
    pub async fn settle(&self, when: &str) {
        let begun = Instant::now();
        // The service notices after a minute that a connection is dead; until then, all of them may be in use.
        while self.not_ended().await != Some(0) || self.get("/readyz").await.status != StatusCode::OK {
            assert!(begun.elapsed() < Duration::from_mins(10), "{when}: submissions are stuck");
            tokio::time::sleep(Duration::from_millis(200)).await;
        }
    }

    /// SIGKILL, at once.
    pub fn kill(mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// SIGTERM, and whether it ended well.
    pub fn terminate(mut self) -> bool {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
        self.process.wait().unwrap().success()
    }

    /// Waits until SIGKILL has ended it; fails after five minutes: a statement on a line that stands still takes more than one.
    pub async fn wait_for_end(mut self, when: &str) {
        for _ in 0..3_000 {
            if let Some(status) = self.process.try_wait().unwrap() {
                assert_eq!(status.signal(), Some(9), "{when}: {status}");
                return;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap_or_default();
        let state = status.lines().find(|line| line.starts_with("State")).unwrap_or("it is gone").to_owned();
        panic!("{when}: the service lives ({state}); it said {:#?}", self.said.lock().unwrap());
    }

    /// Sends it a signal.
    pub fn signal(&self, name: &str) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
    }

    pub fn process_id(&self) -> u32 {
        self.process.id()
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
