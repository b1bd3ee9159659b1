//! What a caller can observe of a hidden evaluation before its epoch closes depends on the score alone: two epochs
//! whose keys differ, one entrant who solves everything and one who solves nothing, and every answer, header, event,
//! metric and log line compared. Each row of the table in docs/hidden-evaluation.md is a test here.

use std::collections::BTreeSet;

use plumbline::store::db::query_scalar;
use tokio::sync::OnceCell;

use crate::support::Answer;
use crate::support::epoch::{Scene, answer_to, id};
use serde_json::{Value, json};

/// Text with all that is random or a time replaced: ids, hashes, times, durations, and the caller's own prompts.
fn plain(text: &str) -> String {
    let is_wordlike = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | ':' | '.' | '_');
    // Receipts that are published together stand in the order of their random hashes.
    let mut parts = text.split("\"seq\":");
    let first = parts.next().map(str::to_owned).unwrap_or_default();
    let text =
        parts.fold(first, |text, part| text + "\"seq\":" + part.trim_start_matches(|c: char| c.is_ascii_digit()));
    let mut out = String::new();
    let mut word = String::new();
    for c in text.chars().chain(['\n']) {
        if is_wordlike(c) {
            word.push(c);
            continue;
        }
        out.push_str(&class(&word));
        word.clear();
        out.push(c);
    }
    out
}

/// A word, or what kind of thing it is where it is random.
fn class(word: &str) -> String {
    if let Some(rest) = word.strip_prefix(':') {
        return format!(":{}", class(rest));
    }
    let hex = |text: &str| text.chars().all(|c| c.is_ascii_hexdigit());
    let is_id = word.len() == 36 && word.split('-').map(str::len).eq([8, 4, 4, 4, 12]) && hex(&word.replace('-', ""));
    // Pages show the beginning of one.
    let is_hash = [16, 64, 128].contains(&word.len()) && hex(word);
    let is_time = word.len() >= 20 && word.starts_with("20") && word.contains('T') && word.ends_with('Z');
    let is_milliseconds = word.len() == 13 && word.chars().all(|c| c.is_ascii_digit());
    let is_request = word.len() == 32 && hex(word);
    let is_fraction = word.contains('.') && word.parse::<f64>().is_ok();
    match () {
        () if word.starts_with("127.0.0.1:") => "HOST".to_owned(),
        () if is_id => "ID".to_owned(),
        () if is_hash => "HASH".to_owned(),
        () if is_request => "REQUEST".to_owned(),
        () if is_time || is_milliseconds => "TIME".to_owned(),
        () if is_fraction => "FRACTION".to_owned(),
        () => word.to_owned(),
    }
}

/// Leaves out what a caller may know: prompts, which are theirs to read, and the score.
fn without_score(value: &mut Value) {
    match value {
        Value::Object(members) => {
            for (name, own) in members.iter_mut() {
                match name.as_str() {
                    "prompts" => *own = "PROMPTS".into(),
                    "passed" | "overall" | "interval" => *own = "SCORE".into(),
                    // Which instances are told now, shown by the board or kept is random.
                    "of" | "told_later" => *own = "PART".into(),
                    _ => without_score(own),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(without_score),
        _ => {}
    }
}

/// Markup without the text that follows each of these.
fn without_text_after(mark: &str, markup: &str) -> String {
    let mut parts = markup.split(mark);
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |text, part| text + &part[part.find('<').unwrap()..])
}

/// What was observed: the row of the table, what it is of, and what it says.
#[derive(Debug, Default)]
struct Observed(Vec<(&'static str, String, String)>);

impl Observed {
    fn note(&mut self, row: &'static str, what: &str, answer: &Answer) {
        let body = serde_json::from_str::<Value>(&answer.text).map_or_else(
            |_| answer.text.clone(),
            |mut value| {
                without_score(&mut value);
                value.to_string()
            },
        );
        // What a clock shows is left out. (The page of one epoch shows what its boards say, with bars; those are
        // compared as JSON.)
        let body = without_text_after("data-until>", &body);
        // The length of a body follows from what is in it, and the date from the clock.
        let own =
            |name: &str| !["date", "content-length", "x-request-id", "etag", "ratelimit-remaining"].contains(&name);
        let headers: BTreeSet<String> = answer
            .headers
            .iter()
            .filter(|(name, _)| own(name.as_str()))
            .map(|(name, value)| plain(&format!("{name}: {value:?}")))
            .collect();
        self.0.push((row, what.to_owned(), format!("{} {headers:?} {}", answer.status, plain(&body))));
    }

    /// Notes the size of an answer that tells no score; times and ids have the same lengths.
    fn size(&mut self, what: &str, answer: &Answer) {
        let has_etag = answer.headers.contains_key("etag");
        self.0.push(("sizes_and_etags", what.to_owned(), format!("{} {has_etag}", plain(&answer.text).len())));
    }

    fn say(&mut self, row: &'static str, what: &str, text: String) {
        self.0.push((row, what.to_owned(), text));
    }
}

/// How often was looked whether an entry is complete is chance, and so is which of its first lines the program writes
/// first.
fn is_chance(line: &str) -> bool {
    // What the start and a look at the epochs say comes in any order, and how long a statement takes.
    ["sqlx::", "method=GET route=\"/v1/entries/{id}\"", "plumbline::startup: listening", "startup::epoch_states"]
        .iter()
        .any(|chance| line.contains(chance))
}

/// Version of an id: 4 is random, 7 begins with the time.
fn version(id: &str) -> String {
    id[14..15].to_owned()
}

/// Everything that an entrant and everybody else can look at, while one goes through a dev entry and an official one.
#[expect(clippy::too_many_lines, reason = "a list of what can be observed")]
async fn observe(solves: bool) -> Observed {
    let scene = Scene::new(&["--dev-feedback", "score-only", "--siblings"]);
    let mut seen = Observed::default();
    let (lab, other) = (scene.key("lab"), scene.key("other"));
    let service = &scene.service;
    let pool = scene.pool();
    for tier in ["dev", "official"] {
        let entry = scene.register(&lab, tier, 1).await;
        let drawn = scene.draw(&lab, &entry, 1).await;
        for (i, instance) in drawn.iter().enumerate() {
            let path = format!("/v1/instances/{}", id(instance));
            let body = answer_to(instance, &pool, !solves);
            let broken = json!({ "turns": [{ "events": [{ "action": "place", "x": 0.5, "y": 0, "z": 0, "material": "stone" }] }] });
            let what = format!("{tier} {i}");
            seen.say("ids", &what, format!("{} of {}", version(id(instance)), version(&entry)));
            let to = format!("{path}/answer");
            seen.note("errors", &format!("{what} malformed"), &scene.post(&lab, &to, &broken).await);
            seen.note("errors", &format!("{what} by another"), &scene.post(&other, &to, &body).await);
            let answered = scene.post(&lab, &to, &body).await;
            seen.note("answers_to_instances", &what, &answered);
            seen.size(&what, &answered);
            seen.note("answers_to_instances", &format!("{what} again"), &scene.post(&lab, &to, &body).await);
            let mut more = body.clone();
            let first = more["turns"][0].clone();
            more["turns"].as_array_mut().unwrap().push(first);
            let told = scene.post(&lab, &format!("{path}/answer"), &more).await;
            assert_eq!(told.faults(422), ["null /turns"], "the number of turns is the number of prompts");
            for part in ["report", "receipt"] {
                seen.note("errors", &format!("{what} {part}"), &service.get(&format!("{path}/{part}")).await);
            }
            for (who, key) in [("the entrant", &lab), ("another", &other)] {
                let get = service.http.get(format!("{}{path}", service.url)).bearer_auth(key);
                seen.note("prompts", &format!("{what} for {who}"), &service.send(get).await);
            }
        }
        // Whether all are graded by now is chance; the ledger must not tell.
        let get = service.http.get(format!("{}/v1/quota?limit=1000", service.url)).bearer_auth(&lab);
        seen.note("ledger", tier, &service.send(get).await);
        seen.note("entries", &format!("{tier} before"), &service.get(&format!("/v1/entries/{entry}")).await);
        scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
        service.wait_for(&format!("/v1/entries/{entry}"), |entry| entry["state"] == "complete").await;
        let complete = service.get(&format!("/v1/entries/{entry}")).await;
        seen.note("entries", &format!("{tier} complete"), &complete);
        for (i, instance) in drawn.iter().enumerate() {
            for part in ["report", "receipt"] {
                let path = format!("/v1/instances/{}/{part}", id(instance));
                seen.note("errors", &format!("{tier} {i} {part} of a complete entry"), &service.get(&path).await);
            }
        }
        if tier == "official" {
            // Of an official entry not even the score is told.
            assert_eq!(complete.json()["result"], Value::Null);
            seen.size("complete", &complete);
        }
    }
    for path in [
        "/v1/epochs",
        "/v1/epochs/autumn",
        "/v1/epochs/autumn/reveal",
        "/v1/epochs/autumn/answers",
        "/v1/epochs/autumn/leaderboard",
        "/v1/epochs/autumn/leaderboard?tier=dev",
        "/v1/receipts?limit=1000",
        "/v1/suites",
        "/v1/tasks?limit=1000",
        "/v1/leaderboards/mineceraft",
        "/v1/leaderboards/hidden",
        "/health",
        "/",
        "/epochs",
    ] {
        seen.note("answers_of_the_api", path, &service.get(path).await);
    }
    let log = service.get("/v1/receipts?limit=1000").await.json();
    let told: Vec<&Value> = log["receipts"].as_array().unwrap().iter().map(|own| &own["receipt"]).collect();
    for announced in told.iter().filter(|receipt| receipt.is_object()) {
        seen.say("announcements", "receipt", plain(&format!("{:?}", announced.as_object().unwrap().keys())));
    }
    assert!(told.iter().any(|receipt| receipt.is_null()), "receipts of the epoch are withheld");
    // Hidden answers are submissions inside; outside there are none.
    let database = crate::support::database::pool(&scene.file("p.db")).await;
    let ids: Vec<String> = query_scalar("SELECT id FROM submissions ORDER BY id").fetch_all(&database).await.unwrap();
    assert_eq!(ids.len(), 26 + 52);
    // The root is a hash of hashes; the size is what an observer can read.
    let checkpoint = service.get("/log/checkpoint").await.text;
    seen.say("public_log", "size", checkpoint.lines().nth(1).unwrap().to_owned());
    seen.note("public_log", "receipts", &service.get("/v1/receipts?limit=1000").await);
    for part in ["", "/report", "/log", "/structure", "/stress", "/receipt", "/cancel"] {
        let path = format!("/v1/submissions/{}{part}", ids[0]);
        let answer =
            if part == "/cancel" { scene.post(&lab, &path, &json!({})).await } else { service.get(&path).await };
        assert_eq!(answer.status, 404, "{path}: {}", answer.text);
    }
    for page in ["/submissions", "/submissions/evidence"] {
        assert_eq!(service.get(&format!("{page}/{}", ids[0])).await.status, 404);
    }
    let events: i64 = query_scalar("SELECT COUNT(*) FROM events").fetch_one(&database).await.unwrap();
    let deliveries: i64 = query_scalar("SELECT COUNT(*) FROM deliveries").fetch_one(&database).await.unwrap();
    assert_eq!((events, deliveries), (0, 0), "an event was written for everybody to follow");
    seen.say("events_and_webhooks", "number", format!("{events} {deliveries}"));
    let metrics = service.get("/metrics").await.text;
    // Counts are compared; what measures time is not the same twice.
    let is_count = |line: &&str| !["seconds", "together", "bytes", "connections"].iter().any(|own| line.contains(own));
    let mut counts: Vec<&str> = metrics.lines().filter(is_count).filter(|line| !line.is_empty()).collect();
    counts.sort_unstable();
    // How often the test had to look until an entry was complete is chance.
    counts.retain(|line| !line.contains("/v1/entries/{id}"));
    seen.0.extend(counts.into_iter().map(|line| ("metrics", "line".to_owned(), line.to_owned())));
    let names: BTreeSet<&str> = metrics
        .lines()
        .filter_map(|line| line.split([' ', '{']).next())
        .filter(|name| !name.starts_with('#'))
        .collect();
    seen.say("metrics", "names", format!("{names:?}"));
    // The log is written by a thread of its own.
    tokio::time::sleep(std::time::Duration::from_millis(500)).await;
    let said = service.said.lock().unwrap().join("\n").replace(scene.folder.path().to_str().unwrap(), "FOLDER");
    // On PostgreSQL the database has another name each time.
    let named = crate::support::database::named(&scene.file("p.db"));
    let said = said.replace(named[1].to_str().unwrap(), "DATABASE");
    let log: Vec<&str> = said.lines().filter(|line| !is_chance(line)).collect();
    seen.say("lines_of_the_service", "all", plain(&log.join("\n")));
    // No secret anywhere.
    let secret = std::fs::read_to_string(scene.file("p.db.secrets/epoch-autumn.json")).unwrap();
    let secret: Value = serde_json::from_str(&secret).unwrap();
    let everything = format!("{:?} {said}", seen.0);
    for name in ["has_enclosed_rooms", "reference_pa", "min_share", secret["key"].as_str().unwrap()] {
        assert!(!everything.contains(name), "{name:?} is told");
    }
    seen
}

static BOTH: OnceCell<(Observed, Observed)> = OnceCell::const_new();

/// Observes both epochs once, and compares what one row of the table is about.
async fn compare(row: &str) {
    let (all, none) = BOTH.get_or_init(async || (Box::pin(observe(true)).await, Box::pin(observe(false)).await)).await;
    let of_row = |seen: &'static Observed| seen.0.iter().filter(|(own, ..)| *own == row).collect::<Vec<_>>();
    let (all, none) = (of_row(all), of_row(none));
    assert!(!all.is_empty(), "nothing was observed");
    assert_eq!(all.len(), none.len());
    for ((_, what, a), (_, other, b)) in all.into_iter().zip(none) {
        assert_eq!(what, other);
        assert_eq!(a, b, "{what} tells");
    }
}

macro_rules! rows {
    ($($row:ident),* $(,)?) => {
        /// Rows of the table that are compared.
        const ROWS: &[&str] = &[$(stringify!($row)),*];

        $(
            #[tokio::test]
            async fn $row() {
                compare(stringify!($row)).await;
            }
        )*
    };
}

rows![
    answers_of_the_api,
    answers_to_instances,
    entries,
    prompts,
    ledger,
    ids,
    sizes_and_etags,
    errors,
    events_and_webhooks,
    metrics,
    public_log,
    announcements,
    lines_of_the_service,
];

/// Hidden answers that wait are not counted among the submissions ahead of a public one.
#[tokio::test]
async fn queue() {
    let mut scene = Scene::new(&[]);
    scene.options = ["--workers", "0"].map(str::to_owned).to_vec();
    scene.restart(None);
    let lab = scene.key("lab");
    let turns = json!([{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]);
    let places = async || {
        let new = json!({ "suite": "mineceraft", "task": 113, "turns": turns });
        let posted = scene.made(&lab, "/v1/submissions", &new).await;
        let told = scene.service.get(&format!("/v1/submissions/{}", id(&posted))).await.json();
        told["queued_before"].as_u64().unwrap()
    };
    assert_eq!(places().await, 0);
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &drawn, 0).await;
    assert_eq!(places().await, 1, "the public one before, and no answer");
}

#[test]
fn every_row_of_the_table_is_a_test() {
    let document = include_str!("../../docs/hidden-evaluation.md");
    let table = document.split("## What an observer may learn").nth(1).unwrap().split("## ").next().unwrap();
    let of_line = |line: &'static str| line.trim_end_matches(" |").rsplit("| ").next();
    let named: BTreeSet<&str> = table.lines().filter(|line| line.ends_with("` |")).filter_map(of_line).collect();
    let tests: BTreeSet<String> = ROWS.iter().chain(&["queue"]).map(|row| format!("`{row}`")).collect();
    assert_eq!(named, tests.iter().map(String::as_str).collect());
}
