//! The clients of a round: labs that submit, trainers that grade, answers of models that are replayed, readers, and those
//! who hang up.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline_engine::tasks::embedded;
use reqwest::{Client, StatusCode};
use serde_json::{Value, json};

use crate::support::database::is_postgres;
use crate::support::{Service, good_build, repository};

/// Pages and documents that readers ask for.
const READ: [&str; 6] = ["/", "/v1/leaderboards/mineceraft", "/v1/suites", "/metrics", "/v1/runs", "/v1/limits"];

/// What clients heard in a round.
#[derive(Default)]
pub struct Heard {
    pub acknowledged: Vec<String>,
    pub graded: usize,
    pub replayed: usize,
    pub refused: usize,
    /// Milliseconds of answers while there was no fault, by kind of request.
    took: BTreeMap<&'static str, Vec<f64>>,
}

impl Heard {
    pub fn add(&mut self, other: Self) {
        self.acknowledged.extend(other.acknowledged);
        self.graded += other.graded;
        self.replayed += other.replayed;
        self.refused += other.refused;
        for (kind, took) in other.took {
            self.took.entry(kind).or_default().extend(took);
        }
    }

    /// Returns the counts, in a line.
    pub fn line(&self) -> String {
        let (accepted, graded) = (self.acknowledged.len(), self.graded);
        format!("accepted {accepted}, graded {graded}, replayed {}, refused {}", self.replayed, self.refused)
    }

    /// Returns the median time of each kind of request, in milliseconds.
    pub fn medians(&self) -> BTreeMap<&'static str, f64> {
        self.took.iter().map(|(kind, took)| (*kind, median(took.clone()))).collect()
    }
}

/// Returns the median of rounds' medians of each kind of request, as a line.
pub fn middle(rounds: &[BTreeMap<&'static str, f64>]) -> String {
    let mut all: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (kind, ms) in rounds.iter().flatten() {
        all.entry(kind).or_default().push(*ms);
    }
    let tell = |(kind, ms)| format!("{kind} {:.2} ms", median(ms));
    all.into_iter().map(tell).collect::<Vec<String>>().join(", ")
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

/// A time of load on one process of the service.
pub struct Round {
    http: Client,
    url: String,
    key: String,
    number: u64,
    is_over: AtomicBool,
    is_faulty: AtomicBool,
}

impl Round {
    pub fn new(service: &Service, key: &str, number: u64) -> Self {
        let http = plumbline::client::without_tls().timeout(Duration::from_secs(30)).build().unwrap();
        let (url, key) = (service.url.clone(), key.to_owned());
        Self { http, url, key, number, is_over: AtomicBool::new(false), is_faulty: AtomicBool::new(false) }
    }

    /// Says that a fault begins: times are not taken any more.
    pub fn begin_fault(&self) {
        self.is_faulty.store(true, Ordering::Relaxed);
    }

    /// Lets the clients end.
    pub fn stop(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Lets all clients work until the round is stopped.
    pub async fn drive(&self) -> Heard {
        let (labs, trainers) = (futures_util::future::join(self.submit(0), self.submit(1)), self.grade());
        let others = futures_util::future::join3(self.replay(), self.read(), self.hang_up());
        let ((one, other), graded, (replayed, read, ())) = tokio::join!(labs, trainers, others);
        let mut heard = Heard::default();
        for part in [one, other, graded, replayed, read] {
            heard.add(part);
        }
        heard
    }

    fn goes_on(&self) -> bool {
        !self.is_over.load(Ordering::Relaxed)
    }

    /// Sends a request, and notes what becomes of it. `None` if it was refused for the time being, or not answered.
    async fn send(&self, heard: &mut Heard, kind: &'static str, path: &str, body: Option<&Value>) -> Option<String> {
        self.send_as(heard, kind, path, body, None).await
    }

    async fn send_as(
        &self,
        heard: &mut Heard,
        kind: &'static str,
        path: &str,
        body: Option<&Value>,
        once: Option<&str>,
    ) -> Option<String> {
        let (begun, url) = (Instant::now(), format!("{}{path}", self.url));
        let mut request = body.map_or_else(|| self.http.get(&url), |body| self.http.post(&url).json(body));
        if let Some(once) = once {
            request = request.header("idempotency-key", once);
        }
        let answer = request.bearer_auth(&self.key).send().await;
        let Ok(answer) = answer else {
            heard.refused += 1;
            tokio::time::sleep(Duration::from_millis(20)).await;
            return None;
        };
        let status = answer.status();
        let text = answer.text().await.ok()?;
        // Code that never ends by itself is ended at a limit, which is an answer.
        if status.is_success() || kind == "replay" && status == StatusCode::UNPROCESSABLE_ENTITY {
            if !self.is_faulty.load(Ordering::Relaxed) {
                heard.took.entry(kind).or_default().push(begun.elapsed().as_secs_f64() * 1e3);
            }
            return Some(text);
        }
        // Connections of a line that was dead are found out by those who use them next.
        let is_expected = is_postgres() || self.is_faulty.load(Ordering::Relaxed);
        assert!(is_expected, "{path} without a fault: {status} {text}");
        let is_temporary = status.is_server_error() || status == StatusCode::TOO_MANY_REQUESTS;
        assert!(is_temporary, "{path}: {status} {text}");
        heard.refused += 1;
        tokio::time::sleep(Duration::from_millis(20)).await;
        None
    }

    /// A lab that posts the builders' builds, each until it is acknowledged, under a key of its own.
    async fn submit(&self, lab: usize) -> Heard {
        let suite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
        let mut heard = Heard::default();
        let mut count = 0;
        while self.goes_on() {
            let body = good_build(&suite.tasks[count % suite.tasks.len()], count % 3 == lab, None);
            let once = format!("soak-{}-{lab}-{count}", self.number);
            while self.goes_on() {
                let said = self.send_as(&mut heard, "submit", "/v1/submissions", Some(&body), Some(&once)).await;
                if let Some(text) = said {
                    let accepted: Value = serde_json::from_str(&text).unwrap();
                    heard.acknowledged.push(accepted["id"].as_str().unwrap().to_owned());
                    break;
                }
            }
            count += 1;
            tokio::time::sleep(Duration::from_millis(40)).await;
        }
        heard
    }

    /// A trainer that grades the same builds again and again, and expects the same grades. It needs no disk.
    async fn grade(&self) -> Heard {
        let suite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
        let bodies: Vec<Value> = suite.tasks.iter().take(12).map(|task| good_build(task, false, None)).collect();
        let (mut heard, mut first) = (Heard::default(), BTreeMap::new());
        for which in (0..bodies.len()).cycle() {
            if !self.goes_on() {
                break;
            }
            let Some(text) = self.send(&mut heard, "grade", "/v1/grade", Some(&bodies[which])).await else { continue };
            let grade: Value = serde_json::from_str(&text).unwrap();
            let scores = (grade["reward"].clone(), grade["criteria"].clone(), grade["passed"].clone());
            assert_eq!(first.entry(which).or_insert_with(|| scores.clone()), &scores, "{text}");
            heard.graded += 1;
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        heard
    }

    /// Answers as models write them, each replayed in a process of its own; some of them never end by themselves.
    async fn replay(&self) -> Heard {
        let folder = repository("tests/actions/answers");
        let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        let (mut heard, mut count) = (Heard::default(), 0);
        while self.goes_on() {
            let file = files[(self.number as usize * 31 + count) % files.len()].join("1.md");
            let endless = "for (;;) await skills.placeBlock(bot, 'stone', 0, 0, 0);".to_owned();
            let code = if count % 40 == 39 { endless } else { std::fs::read_to_string(&file).unwrap_or(endless) };
            let body = json!({ "profile": "mindcraft", "action_code": code });
            let said = self.send(&mut heard, "replay", "/v1/replay", Some(&body)).await;
            heard.replayed += usize::from(said.is_some());
            count += 1;
            tokio::time::sleep(Duration::from_millis(60)).await;
        }
        heard
    }

    /// A reader of pages and documents.
    async fn read(&self) -> Heard {
        let mut heard = Heard::default();
        for path in READ.iter().cycle() {
            if !self.goes_on() {
                break;
            }
            self.send(&mut heard, "read", path, None).await;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        heard
    }

    /// A client that never waits for what it asked for.
    async fn hang_up(&self) {
        let code = "for (let y = 0; y < 64; y++) await skills.placeBlock(bot, 'stone', 0, y, 0);";
        let doors = [("/v1/replay", json!({ "profile": "mindcraft", "action_code": code })), ("/v1/runs", json!({}))];
        for (path, body) in doors.iter().cycle() {
            if !self.goes_on() {
                break;
            }
            let request = self.http.post(format!("{}{path}", self.url)).bearer_auth(&self.key).json(body);
            let _ = request.timeout(Duration::from_millis(4)).send().await;
            tokio::time::sleep(Duration::from_millis(250)).await;
        }
    }
}
