//! A scene of the crash tests: a database with a key to it, work that clients do, and what was acknowledged to them.

use std::cell::RefCell;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use futures_util::StreamExt as _;
use plumbline_engine::checks::Criterion;
use plumbline_engine::tasks::embedded;
use reqwest::{RequestBuilder, StatusCode};
use serde_json::{Value, json};

use crate::support::audit::audit;
use crate::support::commands::{key, plumbline, succeeded};
use crate::support::place::Place;
use crate::support::{PROGRAM, Service};

pub const LEASE: [&str; 2] = ["--lease-seconds", "1"];

/// How often a request is tried where there are faults.
const MAX_TRIES: usize = 500;

/// A database with a key to it, and what was acknowledged.
pub struct Scene {
    _folder: tempfile::TempDir,
    pub database: PathBuf,
    pub key: String,
    pub acknowledged: Vec<String>,
    /// Length of the leases of its services.
    pub lease: [&'static str; 2],
    /// Whether the disk or the line to the server has faults, so that requests may be refused for a time.
    has_faults: bool,
    /// Outcome of the last request.
    last: RefCell<String>,
}

impl Scene {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("p.db");
        succeeded(&plumbline(&["migrate", "--create"], &database));
        let key = key(&database, "lab");
        Self {
            _folder: folder,
            database,
            key,
            acknowledged: Vec::new(),
            lease: LEASE,
            has_faults: false,
            last: RefCell::default(),
        }
    }

    /// A scene with faults, and where they are made.
    pub async fn with_faults() -> (Self, Place) {
        let folder = tempfile::tempdir().unwrap();
        let place = Place::new(folder.path()).await;
        let (database, key) = (place.database.clone(), place.key.clone());
        (
            Self {
                _folder: folder,
                database,
                key,
                acknowledged: Vec::new(),
                lease: LEASE,
                has_faults: true,
                last: RefCell::default(),
            },
            place,
        )
    }

    pub fn start(&self) -> Service {
        Service::start_as_told(&self.database, &self.lease)
    }

    pub fn start_to_die(&self, moment: &str) -> Service {
        let mut command = Command::new(PROGRAM);
        command.env("PLUMBLINE_TEST_KILL", moment);
        Service::start_by(command, &self.database, &self.lease)
    }

    /// Starts a service that dies by itself, soon.
    pub fn start_and_die(&self, moment: &str) {
        // `timeout` ends with another signal, so a service that lives on fails the test instead of holding it up.
        let mut command = Command::new("timeout");
        command.args(["--signal=INT", "600", PROGRAM, "serve", "--listen", "127.0.0.1:0"]);
        let ended = command
            .args(crate::support::database::named(&self.database))
            .args(self.lease)
            .env("PLUMBLINE_TEST_KILL", moment)
            .output()
            .unwrap();
        let is_killed = ended.status.signal() == Some(9) || ended.status.code() == Some(128 + 9);
        assert!(is_killed, "{moment}: {ended:?}");
    }

    /// Sends a request until it succeeds. Returns `None` on a conflict, or if the service dies first.
    pub async fn send(&self, request: RequestBuilder) -> Option<Value> {
        let request = request.bearer_auth(&self.key);
        for _ in 0..MAX_TRIES {
            let answer = match request.try_clone().expect("the body is in memory").send().await {
                Ok(answer) => answer,
                Err(error) => return self.note(format!("{error:?}")),
            };
            let status = answer.status();
            let text = match answer.text().await {
                Ok(text) => text,
                Err(error) => return self.note(format!("{status} {error:?}")),
            };
            self.note(format!("{status} {text}"));
            let body: Value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{status} {text}"));
            if status.is_success() || status == StatusCode::CONFLICT {
                return status.is_success().then_some(body);
            }
            let is_ours = status.is_server_error() || status == StatusCode::REQUEST_TIMEOUT;
            assert!(self.has_faults && is_ours && body["retryable"] == true, "{status} {body}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        panic!("a request is refused without end");
    }

    fn note(&self, what: String) -> Option<Value> {
        *self.last.borrow_mut() = what;
        None
    }

    /// Returns the outcome of the last request.
    pub fn last(&self) -> String {
        self.last.borrow().clone()
    }

    /// Posts a log, and notes that it was acknowledged.
    pub async fn post(&mut self, service: &Service, body: Value) -> Option<String> {
        let accepted = self.send(service.http.post(format!("{}/v1/submissions", service.url)).json(&body)).await?;
        let id = accepted["id"].as_str().unwrap().to_owned();
        self.acknowledged.push(id.clone());
        Some(id)
    }

    /// A run with a few submissions, one without a run, one that takes a while and one that is cancelled, and the end.
    pub async fn work(&mut self, service: &Service) -> Option<()> {
        let url = |path: &str| format!("{}{path}", service.url);
        let begin = service.http.post(url("/v1/runs")).json(&json!({ "agent": "a", "suite": "mineceraft" }));
        let run = self.send(begin).await?["id"].as_str().unwrap().to_owned();
        self.post(service, slow()).await?;
        let mut long = slow();
        let mut cancelled =
            self.post(service, json!({ "run": run, "task": long["task"], "turns": long["turns"] })).await?;
        for task in 1..3 {
            let log = json!({ "palette": ["stone"], "rows": [[task, 0, 0, 0]] });
            self.post(service, json!({ "run": run, "task": task, "turns": [log] })).await?;
        }
        // A machine that is fast, or held up its client, has graded it already; then another is cancelled.
        for x in 1..10 {
            if self.send(service.http.post(url(&format!("/v1/submissions/{cancelled}/cancel")))).await.is_some() {
                break;
            }
            long["turns"][0]["rows"][0] = json!([-x, 0, 0, 0]);
            cancelled = self.post(service, long.clone()).await?;
        }
        self.send(service.http.post(url(&format!("/v1/runs/{run}/finish")))).await?;
        Some(())
    }

    /// Starts a service without faults, waits until no work is left, and audits the database.
    pub async fn end_well(&self, when: &str) {
        let service = self.start();
        service.settle(when).await;
        assert!(service.terminate());
        audit(&self.database, &self.acknowledged, when).await;
    }
}

/// Plays scenes, so many at a time, each on a thread of its own. Starting a service blocks its thread, which would hold up
/// the requests of another scene until the other service hangs up. Returns what each gives, in the order of their ends.
pub async fn on_threads<S, F>(scenes: impl IntoIterator<Item = S>, at_once: usize, play: fn(S) -> F) -> Vec<F::Output>
where
    S: Send + 'static,
    F: Future<Output: Send> + 'static,
{
    let runtime = tokio::runtime::Handle::current();
    let start = |scene| {
        let runtime = runtime.clone();
        tokio::task::spawn_blocking(move || runtime.block_on(play(scene)))
    };
    futures_util::stream::iter(scenes).map(start).buffer_unordered(at_once).map(Result::unwrap).collect().await
}

/// A cube under stress: grading it takes longer than the interval at which a lease is renewed.
pub fn slow() -> Value {
    let suite = embedded::latest().unwrap();
    let is_stressed = |task: &&plumbline_engine::tasks::Task| {
        task.turns.len() == 1 && task.checks().any(|c| c.criterion() == Criterion::StructuralStability)
    };
    let task = suite.tasks.iter().find(is_stressed).unwrap();
    let rows: Vec<Value> = (0..20 * 20 * 20).map(|i| json!([i / 400, i / 20 % 20, i % 20, 0])).collect();
    json!({ "task": task.number, "turns": [{ "palette": ["stone"], "rows": rows }] })
}
