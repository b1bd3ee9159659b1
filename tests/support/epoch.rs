//! A service with an epoch, for tests of hidden evaluation.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use plumbline::store::db::query_scalar;
use plumbline_engine::hidden::GENERATOR_VERSION;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::receipts::{ReceiptFile, Signer, link};
use plumbline_engine::hidden::siblings::Siblings;
use plumbline_engine::tasks::{Task, hex};
use reqwest::StatusCode;
use serde_json::{Value, json};

use super::{Answer, PROGRAM, Service};

pub const CONFIGURATION: &str = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08";

/// A service with an epoch that closes in an hour, a clock that the test sets, and labs with keys.
pub struct Scene {
    pub folder: tempfile::TempDir,
    pub service: Service,
    /// Seconds between two times at which what hidden evaluation came to is told; for the next start.
    pub publish_every: u64,
    /// More options of `serve`, for the next start.
    pub options: Vec<String>,
}

pub fn run(arguments: &[&str], database: Option<&Path>) -> Output {
    let mut command = Command::new(PROGRAM);
    command.args(arguments);
    if let Some(database) = database {
        command.args(super::database::named(database));
    }
    command.output().unwrap()
}

pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

impl Scene {
    pub fn new(options: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("p.db");
        assert!(run(&["migrate", "--create"], Some(&database)).status.success());
        let closes = jiff::Timestamp::now() + jiff::SignedDuration::from_hours(1);
        let closes = closes.to_string();
        let mut create = vec!["epochs", "create", "autumn", "--closes", &closes];
        for (option, value) in [("--per-instance", "3"), ("--owner-percent", "100")] {
            if !options.contains(&option) {
                create.extend([option, value]);
            }
        }
        // Siblings double the answers; the tests that are about them ask for them.
        let (asked, options): (Vec<&str>, Vec<&str>) = options.iter().partition(|option| **option == "--siblings");
        create.extend(options);
        create.extend(asked.is_empty().then_some("--no-siblings"));
        let made = run(&create, Some(&database));
        assert!(made.status.success(), "{}", said(&made));
        std::fs::write(folder.path().join("clock"), "0").unwrap();
        let service = Self::serve(folder.path(), None, 1, &[]);
        Self { folder, service, publish_every: 1, options: Vec::new() }
    }

    /// The same, without options, where nothing is told until the test starts the service anew with another
    /// [`publish_every`](Self::publish_every).
    pub fn withholding() -> Self {
        let mut scene = Self::new(&[]);
        scene.publish_every = 86_400;
        scene.restart(None);
        scene
    }

    /// Starts the service in a scene's folder; at a crash point it shall die.
    fn serve(folder: &Path, dies_at: Option<&str>, publish_every: u64, options: &[String]) -> Service {
        let mut command = Command::new(PROGRAM);
        command.env("PLUMBLINE_TEST_CLOCK", folder.join("clock"));
        if let Some(point) = dies_at {
            command.env("PLUMBLINE_TEST_KILL", point);
        }
        let every = publish_every.to_string();
        let mut arguments = vec!["--lease-seconds", "1", "--hidden-publish-seconds", &every];
        arguments.extend(options.iter().map(String::as_str));
        Service::start_by(command, &folder.join("p.db"), &arguments)
    }

    /// Ends the service and starts it again.
    pub fn restart(&mut self, dies_at: Option<&str>) {
        // One that was to die may have done so.
        let _ = self.service.process.kill();
        let _ = self.service.process.wait();
        self.service = Self::serve(self.folder.path(), dies_at, self.publish_every, &self.options);
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn key(&self, owner: &str) -> String {
        let made = run(&["keys", "create", "--name", owner], Some(&self.file("p.db")));
        String::from_utf8(made.stdout).unwrap().trim().to_owned()
    }

    /// Sets the clock to after the epoch's end, and waits until its results are sealed.
    pub async fn end_epoch(&self) {
        self.set_clock(7_200_000);
        self.is_sealed().await;
    }

    /// Waits until the results of the epoch are sealed; it is over.
    pub async fn is_sealed(&self) {
        let is_sealed = |reveal: &Value| reveal["type"] != "urn:plumbline:problem:still-grading";
        self.service.wait_for("/v1/epochs/autumn/reveal", is_sealed).await;
    }

    /// Moves the service in time: it is as if so many milliseconds had passed.
    pub fn set_clock(&self, ms: i64) {
        self.write_clock(&ms.to_string());
    }

    /// Makes the clock of the service's machine jump by so many milliseconds.
    pub fn jump_clock(&self, ms: i64) {
        self.write_clock(&format!("0 {ms}"));
    }

    fn write_clock(&self, text: &str) {
        // At once: the service must not read a file that is half written.
        std::fs::write(self.file("clock.new"), text).unwrap();
        std::fs::rename(self.file("clock.new"), self.file("clock")).unwrap();
    }

    pub async fn post(&self, key: &str, path: &str, body: &Value) -> Answer {
        let request = self.service.http.post(format!("{}{path}", self.service.url));
        let request = if key.is_empty() { request } else { request.bearer_auth(key) };
        self.service.send(request.json(body)).await
    }

    pub async fn made(&self, key: &str, path: &str, body: &Value) -> Value {
        let answer = self.post(key, path, body).await;
        assert!(answer.status.is_success(), "{path}: {}", answer.text);
        answer.json()
    }

    pub async fn refused(&self, key: &str, path: &str, body: &Value, kind: &str) {
        let answer = self.post(key, path, body).await;
        let found = answer.json()["type"].as_str().unwrap_or_default().to_owned();
        assert_eq!(
            (answer.status, found),
            (StatusCode::CONFLICT, format!("urn:plumbline:problem:{kind}")),
            "{}",
            answer.text
        );
    }

    pub async fn register(&self, key: &str, tier: &str, runs: u32) -> String {
        let new = json!({ "agent": "builder 1", "configuration_sha256": CONFIGURATION, "tier": tier, "runs": runs });
        self.made(key, "/v1/epochs/autumn/entries", &new).await["id"].as_str().unwrap().to_owned()
    }

    pub async fn draw(&self, key: &str, entry: &str, run: u32) -> Vec<Value> {
        let draw = json!({ "run": run, "nonce": format!("a nonce of our own {run}") });
        let drawn = self.made(key, &format!("/v1/entries/{entry}/instances"), &draw).await;
        drawn["instances"].as_array().unwrap().clone()
    }

    /// The tasks of the pool by their prompts, which the operator could look up and a lab cannot, and the public
    /// siblings.
    pub fn pool(&self) -> BTreeMap<Vec<String>, Task> {
        let bound = self.file("p.db.secrets/epoch-autumn.pool.json");
        let file = if bound.is_file() { bound } else { self.file("p.db.secrets/epoch-autumn.json") };
        pool_of(&file)
    }

    /// Answers instances with the reference builds, but for the first so many, which are answered with nothing.
    pub async fn answer(&self, key: &str, instances: &[Value], spoiled: usize) {
        let pool = self.pool();
        for (i, instance) in instances.iter().enumerate() {
            let body = answer_to(instance, &pool, i < spoiled);
            let taken = self.made(key, &format!("/v1/instances/{}/answer", id(instance)), &body).await;
            assert_eq!(taken["repeated"], false, "{taken}");
        }
    }
}

/// The tasks of the pool in a file of an epoch, and the public siblings, by their prompts.
pub fn pool_of(file: &Path) -> BTreeMap<Vec<String>, Task> {
    let text = std::fs::read(file).unwrap();
    let secret: Value = serde_json::from_slice(&text).unwrap();
    let tasks = secret["specifications"].as_array().unwrap().iter();
    let task = |own: &Value| serde_json::from_value::<Task>(own["task"].clone()).unwrap();
    let siblings = Siblings::of(GENERATOR_VERSION).unwrap().specifications().iter().map(|own| own.task.clone());
    tasks
        .map(task)
        .chain(siblings)
        .map(|task| (task.turns.iter().map(|turn| turn.prompt.clone()).collect(), task))
        .collect()
}

pub fn id(of: &Value) -> &str {
    of["id"].as_str().unwrap()
}

pub fn answer_to(instance: &Value, pool: &BTreeMap<Vec<String>, Task>, is_spoiled: bool) -> Value {
    let prompts: Vec<String> = serde_json::from_value(instance["prompts"].clone()).unwrap();
    let mut body = super::good_build(&pool[&prompts], is_spoiled, None);
    body.as_object_mut().unwrap().remove("task");
    body
}

/// Waits until so many reports are stored, as only the operator can see it.
pub async fn all_are_graded(scene: &Scene, wanted: i64) {
    let pool = super::database::pool(&scene.file("p.db")).await;
    for _ in 0..3_000 {
        let found: i64 = query_scalar("SELECT COUNT(*) FROM reports").fetch_one(&pool).await.unwrap();
        if found == wanted {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    panic!("not all are graded");
}

/// Signs a receipt and puts it behind the last one of a log, as whoever has the key could.
pub fn appended(last: &ReceiptFile, receipt: Value, signer: &Signer) -> ReceiptFile {
    let signed = signer.sign(&receipt);
    ReceiptFile {
        seq: last.seq + 1,
        receipt: Some(receipt),
        hash: hex(&signed.hash),
        signature: Some(signed.signature),
        public_key: signer.public_key(),
        previous: last.link.clone(),
        link: hex(&link(&unhex(&last.link).unwrap(), &signed.hash)),
        place_signature: None,
        inclusion: None,
    }
}
