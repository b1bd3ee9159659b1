//! Work of the service for a request: the program itself runs under callgrind, and requests come over a socket.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use plumbline_engine::builders::build;
use plumbline_engine::tasks::{Task, embedded};
use serde_json::{Value, json};

use crate::{Count, callgrind, total};

/// Number of requests of a case. A count is of one of them.
const REQUESTS: u64 = 500;

/// Time that the service gets to end what it does at its start.
const START: Duration = Duration::from_secs(5);
/// Time for which it is watched while nobody asks.
const IDLE: Duration = Duration::from_secs(10);

/// A request: a path, and what is posted there, if anything.
struct Asked {
    name: &'static str,
    path: &'static str,
    body: Option<String>,
}

/// A service that callgrind counts, which ends with this value.
struct Counted {
    process: Child,
    url: String,
}

impl Drop for Counted {
    fn drop(&mut self) {
        // Nobody needs what it would say at its end.
        drop(self.process.kill());
        drop(self.process.wait());
    }
}

/// Runs the service under callgrind and counts the instructions of each kind of request.
pub fn counts(program: &Path, folder: &Path) -> anyhow::Result<Vec<Count>> {
    let service = start(program, folder)?;
    plumbline::tls::use_tls();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    // Callgrind numbers its dumps.
    let counted = |dump: usize| {
        control(&service, "--dump")?;
        total(&folder.join(format!("service.{dump}")))
    };
    let mut counts = Vec::new();
    // What the service does from time to time, whether anybody asks or not, is not the work of a request.
    std::thread::sleep(START);
    control(&service, "--zero")?;
    std::thread::sleep(IDLE);
    let idle_a_second = counted(1)? as f64 / IDLE.as_secs_f64();
    for (number, asked) in requests()?.iter().enumerate() {
        // The service closes connections that were idle for long.
        let client = reqwest::Client::builder().build()?;
        let ask = |times: u64| runtime.block_on(ask(&client, &service.url, asked, times));
        ask(20)?;
        control(&service, "--zero")?;
        let begun = Instant::now();
        ask(REQUESTS)?;
        let idle = begun.elapsed().as_secs_f64() * idle_a_second;
        counts.push((asked.name.to_owned(), counted(number + 2)?.saturating_sub(idle as u64) / REQUESTS));
    }
    Ok(counts)
}

fn start(program: &Path, folder: &Path) -> anyhow::Result<Counted> {
    let mut command = callgrind(&folder.join("service"), &[], program);
    command.args([
        "serve",
        "--open",
        "--listen",
        "127.0.0.1:0",
        "--workers",
        "0",
        "--grade-cache-mib",
        "0",
        "--database",
    ]);
    let mut process = command.arg(folder.join("p.db")).stderr(Stdio::piped()).spawn()?;
    let mut lines = BufReader::new(process.stderr.take().context("its output is piped")?).lines();
    let mut service = Counted { process, url: String::new() };
    let said = lines.by_ref().find_map(|line| line.ok()?.strip_prefix("plumbline is at ").map(ToOwned::to_owned));
    let said = said.context("the service did not start")?;
    service.url = said.split('/').take(3).collect::<Vec<_>>().join("/");
    // What it says later must be read, or it would block.
    std::thread::spawn(move || lines.for_each(drop));
    Ok(service)
}

/// Tells callgrind to do something in the process of the service.
fn control(service: &Counted, what: &str) -> anyhow::Result<()> {
    let done = Command::new("callgrind_control").arg(what).arg(service.process.id().to_string()).output()?;
    anyhow::ensure!(done.status.success(), "callgrind_control: {}", String::from_utf8_lossy(&done.stdout));
    Ok(())
}

async fn ask(client: &reqwest::Client, url: &str, asked: &Asked, times: u64) -> anyhow::Result<()> {
    let url = format!("{url}{}", asked.path);
    for _ in 0..times {
        let request = match &asked.body {
            Some(body) => client.post(&url).header("content-type", "application/json").body(body.clone()),
            None => client.get(&url),
        };
        let response = request.send().await?;
        anyhow::ensure!(response.status().is_success(), "{}: {}", asked.name, response.text().await?);
        response.bytes().await?;
    }
    Ok(())
}

fn requests() -> anyhow::Result<Vec<Asked>> {
    let suite = embedded::suite(2).map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    let wall = suite.tasks.iter().find(|task| task.id == "walls/10x2x7-raise").context("there is no such wall")?;
    let graded = posted(wall)?;
    let get = |name, path| Asked { name, path, body: None };
    let post = |name, path, body: &Value| Asked { name, path, body: Some(body.to_string()) };
    Ok(vec![
        get("GET a board", "/v1/leaderboards/mineceraft@2"),
        get("GET the home page", "/"),
        get("GET the page of a task", "/suites/mineceraft@2/tasks/1"),
        get("GET a task", "/v1/tasks/walls/10x2x7-raise?suite=mineceraft@2"),
        post("POST a wall to /v1/grade", "/v1/grade", &graded),
        post("POST a wall to /v1/submissions", "/v1/submissions", &graded),
    ])
}

/// Returns a body with the builders' own log for a task.
fn posted(task: &Task) -> anyhow::Result<Value> {
    let log = build(task).map_err(|error| anyhow::anyhow!("{error}"))?;
    let log: Value = serde_json::from_slice(&log.canonical_json())?;
    let turns = log["turns"].as_array().context("a log has turns")?;
    let turns: Vec<Value> = turns.iter().map(|rows| json!({ "palette": log["palette"], "rows": rows })).collect();
    Ok(json!({ "suite": "mineceraft@2", "task": task.number, "turns": turns }))
}
