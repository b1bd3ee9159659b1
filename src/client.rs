//! HTTP client of services, which commands and the demo agents use.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use anyhow::{Context as _, bail};
use reqwest::{Client, ClientBuilder, RequestBuilder, StatusCode};
use serde_json::{Value, json};

use crate::tls::use_tls;
use plumbline_engine::hidden::beacon::{Beacon, Round};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::BlockLog;

/// Maximum number of submissions in one body.
const BATCH_LINES: usize = 100;
/// Size in bytes at which a body is sent.
const BATCH_BYTES: usize = 8 << 20;
/// Characters of a refusal that are shown.
const MAX_TOLD: usize = 2_000;
/// Number of faults of a refusal that are told.
const MAX_FAULTS: usize = 10;
/// Interval between two requests for the state of a run.
const LOOK: Duration = Duration::from_millis(200);

/// Address of the servers of the public randomness beacon.
pub const DRAND: &str = "https://api.drand.sh";

/// Downloads a round from a server of the beacon.
///
/// # Errors
/// Returns an error if the server cannot be reached or answers something else.
pub async fn fetch_round(server: &str, beacon: &Beacon) -> anyhow::Result<Round> {
    let round = Service::at(server, None)?.get(&format!("/{}/public/{}", beacon.chain_hash, beacon.round)).await?;
    Ok(serde_json::from_value(round)?)
}

/// Returns the builder of a client without TLS, which needs no certificates of the system.
pub fn without_tls() -> ClientBuilder {
    use_tls();
    Client::builder().tls_certs_only([])
}

/// Client of one service.
#[derive(Debug, Clone)]
pub struct Service {
    http: Client,
    base: String,
    key: Option<String>,
}

/// Answer to one task.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Number of the task in its suite.
    pub number: u32,
    /// Log of the build.
    pub log: BlockLog,
}

impl Service {
    /// Creates a client of the service at this address, such as `http://localhost:7586`, with the key for writing, if
    /// any.
    ///
    /// # Errors
    /// Returns an error if the HTTP client cannot be created.
    pub fn at(base: &str, key: Option<&str>) -> anyhow::Result<Self> {
        let base = if base.contains("://") { base.to_owned() } else { format!("http://{base}") };
        use_tls();
        let builder = if base.starts_with("https://") { Client::builder() } else { without_tls() };
        let builder = builder.timeout(Duration::from_mins(2));
        // A proxy from the environment cannot reach this machine.
        let is_local = ["//localhost", "//127.", "//[::1]"].iter().any(|host| base.contains(host));
        let http = if is_local { builder.no_proxy() } else { builder }.build()?;
        Ok(Self { http, base: base.trim_end_matches('/').to_owned(), key: key.map(str::to_owned) })
    }

    /// Sends a request, and returns the bytes of the answer.
    async fn answer(&self, request: RequestBuilder) -> anyhow::Result<Vec<u8>> {
        let response = request.send().await.with_context(|| format!("cannot reach {}", self.base))?;
        let (status, url) = (response.status(), response.url().clone());
        let bytes = response.bytes().await.with_context(|| url.to_string())?;
        if !status.is_success() {
            let told: String = told(&bytes).chars().take(MAX_TOLD).collect();
            let is_keyless = status == StatusCode::UNAUTHORIZED;
            let remedy = if is_keyless { "; a key is given with --key or PLUMBLINE_KEY" } else { "" };
            bail!("{url}: {status}: {told}{remedy}");
        }
        Ok(bytes.into())
    }

    async fn send(&self, request: RequestBuilder) -> anyhow::Result<Value> {
        Ok(serde_json::from_slice(&self.answer(request).await?)?)
    }

    async fn post(&self, path: &str, kind: &'static str, body: String) -> anyhow::Result<Value> {
        let mut request = self.http.post(format!("{}{path}", self.base));
        if let Some(key) = &self.key {
            request = request.bearer_auth(key);
        }
        self.send(request.header("content-type", kind).body(body)).await
    }

    /// Posts plain text.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached, or refuses.
    pub async fn post_text(&self, path: &str, body: String) -> anyhow::Result<()> {
        let request = self.http.post(format!("{}{path}", self.base));
        self.answer(request.header("content-type", "text/plain; charset=utf-8").body(body)).await.map(drop)
    }

    /// Requests a path, and returns the bytes of the answer.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached, or refuses.
    pub async fn get_bytes(&self, path: &str) -> anyhow::Result<Vec<u8>> {
        self.answer(self.http.get(format!("{}{path}", self.base))).await
    }

    /// Gets a JSON document from the service.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached or rejects a request.
    pub async fn get(&self, path: &str) -> anyhow::Result<Value> {
        self.send(self.http.get(format!("{}{path}", self.base))).await
    }

    /// Gets the tasks of a suite: their numbers, each with its first prompt.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached or rejects a request.
    pub async fn prompts(&self, suite: &str) -> anyhow::Result<BTreeMap<u32, String>> {
        let tasks = self.items(&format!("/v1/tasks?suite={suite}"), "tasks").await?;
        let read = |task: &Value| Some((number(task)?, task["prompt"].as_str()?.to_owned()));
        tasks.iter().map(|task| read(task).context("a task has no number or no prompt")).collect()
    }

    /// Gets the numbers of the tasks that a run has answers to.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached or rejects a request.
    pub async fn answered(&self, run: &str) -> anyhow::Result<BTreeSet<u32>> {
        let submissions = self.items(&format!("/v1/runs/{run}/submissions?"), "submissions").await?;
        Ok(submissions.iter().filter_map(number).collect())
    }

    /// Gets all items of a list that comes in pages.
    async fn items(&self, path: &str, list: &str) -> anyhow::Result<Vec<Value>> {
        let mut items = Vec::new();
        let mut after = Value::from(0);
        while !after.is_null() {
            let page = self.get(&format!("{path}&limit=1000&after={after}")).await?;
            items.extend(page[list].as_array().into_iter().flatten().cloned());
            after = page["next_after"].clone();
        }
        Ok(items)
    }

    /// Creates a run and returns its id.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached or rejects a request.
    pub async fn create_run(&self, agent: &str, suite: &str, metadata: Value) -> anyhow::Result<String> {
        let body = json!({ "agent": agent, "suite": suite, "metadata": metadata });
        let run = self.post("/v1/runs", "application/json", body.to_string()).await?;
        Ok(run["id"].as_str().context("the run has no id")?.to_owned())
    }

    /// Posts answers to a run in bodies of several lines, and calls `posted` with the number of answers in each.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached or rejects a request.
    pub async fn post_answers(
        &self,
        run: &str,
        answers: &[Answer],
        mut posted: impl FnMut(usize),
    ) -> anyhow::Result<()> {
        let mut body = String::new();
        let mut lines = 0;
        for (i, answer) in (1..).zip(answers) {
            body.push_str(&line(run, answer));
            body.push('\n');
            lines += 1;
            if lines == BATCH_LINES || body.len() >= BATCH_BYTES || i == answers.len() {
                self.post("/v1/submissions", "application/x-ndjson", std::mem::take(&mut body)).await?;
                posted(std::mem::take(&mut lines));
            }
        }
        Ok(())
    }

    /// Finishes a run, stating whether unanswered tasks are skipped on purpose; waits until it has finished and returns
    /// it. Meanwhile it calls `graded` with the number of graded submissions.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached, rejects a request, or failed to grade a submission.
    pub async fn finish_run(&self, run: &str, skips_rest: bool, mut graded: impl FnMut(u64)) -> anyhow::Result<Value> {
        // Of a run that is finishing or finished, which ended meanwhile, nothing more can be skipped.
        let is_open = self.get(&format!("/v1/runs/{run}")).await?["state"] == "open";
        let body = if skips_rest && is_open { json!({ "skip": "unanswered" }) } else { json!({}) };
        self.post(&format!("/v1/runs/{run}/finish"), "application/json", body.to_string()).await?;
        loop {
            let state = self.get(&format!("/v1/runs/{run}")).await?;
            graded(state["graded"].as_u64().unwrap_or_default());
            if state["state"] == "finished" {
                return Ok(state);
            }
            if state["pending"] == 0 && state["grader_errors"] != 0 {
                let failed = counted(state["grader_errors"].as_u64().unwrap_or_default(), "submission");
                bail!(
                    "the service failed to grade {failed} of run {run}; its operator can have that done (plumbline failures)"
                );
            }
            tokio::time::sleep(LOOK).await;
        }
    }
}

/// Returns the number of a task or an answer.
fn number(item: &Value) -> Option<u32> {
    u32::try_from(item["number"].as_u64()?).ok()
}

/// Returns what a refusal says: the detail of a problem with its kind and its first faults, or the text as it is.
fn told(answer: &[u8]) -> String {
    let problem: Value = serde_json::from_slice(answer).unwrap_or_default();
    let (Some(detail), Some(kind)) = (problem["detail"].as_str(), problem["type"].as_str()) else {
        return String::from_utf8_lossy(answer).into_owned();
    };
    let kind = kind.rsplit(':').next().unwrap_or(kind);
    let faults = problem["faults"].as_array().map(Vec::as_slice).unwrap_or_default();
    let text = |fault: &Value, name: &str| fault[name].as_str().unwrap_or_default().to_owned();
    let line = |fault: &Value| {
        let line = fault["line"].as_u64().map(|line| format!("line {line}"));
        let place = Some(text(fault, "pointer") + &text(fault, "parameter")).filter(|place| !place.is_empty());
        let place: Vec<String> = line.into_iter().chain(place).chain([text(fault, "detail")]).collect();
        format!("\n  {}", place.join(": "))
    };
    let lines = faults.iter().map(line);
    // The detail of a problem with a single fault is often that fault.
    let lines: Vec<String> = lines.filter(|told| !detail.contains(told.trim_start())).take(MAX_FAULTS).collect();
    let more = faults.len().saturating_sub(MAX_FAULTS);
    let more = if more > 0 { format!("\n  and {}", counted(more, "more fault")) } else { String::new() };
    format!("{detail} ({kind}){}{more}", lines.concat())
}

/// Returns an NDJSON line in the compact form, with the log's palette in each turn.
fn line(run: &str, answer: &Answer) -> String {
    json!({ "run": run, "task": answer.number, "turns": answer.log.compact_turns() }).to_string()
}
