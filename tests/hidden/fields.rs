//! A generated list of tamperings: every field of every published document, changed, removed and exchanged.

use std::collections::{BTreeMap, BTreeSet};

use plumbline_engine::hidden::receipts::LogPage;
use plumbline_engine::hidden::reveal::Reveal;
use plumbline_engine::hidden::verify::{Kept, verify};
use plumbline_engine::voxel::BlockLog;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

/// Everything that is published of an epoch that is over, and two copies of its commitment: before the round and after
/// it.
pub struct Published {
    pub early: Value,
    pub late: Value,
    pub reveal: Value,
    pub answers: String,
    pub log: Value,
    pub board: Value,
}

/// Fields that say nothing that could be wrong.
const SILENT: &[(&str, &str)] = &[
    ("reveal", "/receipts/*/place_signature"),
    ("reveal", "/receipts/*/inclusion"),
    ("log", "/next_after"),
    ("log", "/receipts/*/place_signature"),
    ("log", "/receipts/*/inclusion"),
];

/// Lists whose entries say their own places, so that their order says nothing, nor does an entry that occurs twice in
/// the pages of the log.
const UNORDERED: &[&str] = &[
    "answers/*: exchanged with the next",
    // Pages that begin later are told as not checked.
    "log/receipts/*: removed",
    "log/receipts/*: exchanged with the next",
    "log/receipts/*: replayed",
    "reveal/receipts/*: exchanged with the next",
    "reveal/specifications/*: exchanged with the next",
];

impl Published {
    fn documents(&self) -> Map<String, Value> {
        let answers: Vec<Value> = self.answers.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let all = json!({ "reveal": self.reveal, "log": self.log, "board": self.board, "answers": answers,
                          "early": self.early["commitment"], "late": self.late["pool"] });
        all.as_object().unwrap().clone()
    }

    /// Changes each field in every way and asserts that the verifier finds each change.
    pub fn must_show_every_change(&self) {
        let documents = self.documents();
        let good = breaches(&documents).unwrap();
        assert_eq!(good, Vec::<String>::new());
        let mut changes = Vec::new();
        for (name, document) in &documents {
            for (place, pointer) in fields(document) {
                if SILENT.iter().any(|(of, own)| of == name && place.starts_with(own)) {
                    continue;
                }
                for (way, changed) in changes_of(document, &pointer) {
                    changes.push((format!("{name}{place}: {way}"), name, changed));
                }
            }
        }
        let is_missed = |(_, name, changed): &(String, &String, Value)| {
            let mut documents = documents.clone();
            documents.insert((*name).clone(), changed.clone());
            // What cannot even be read is found as well.
            breaches(&documents).is_some_and(|found| found.is_empty())
        };
        let missed = changes.par_iter().filter(|change| is_missed(change)).map(|(told, ..)| told.as_str());
        let missed: Vec<&str> = missed.filter(|told| !UNORDERED.contains(told)).collect();
        assert!(changes.len() > 800, "{}", changes.len());
        assert_eq!(missed, Vec::<&str>::new(), "{} of {}", missed.len(), changes.len());
    }
}

/// Verifies the documents; `None` if one cannot be read.
fn breaches(documents: &Map<String, Value>) -> Option<Vec<String>> {
    let reveal: Reveal = serde_json::from_value(documents["reveal"].clone()).ok()?;
    let page: LogPage = serde_json::from_value(documents["log"].clone()).ok()?;
    let mut logs = BTreeMap::new();
    for answer in documents["answers"].as_array()? {
        let log = BlockLog::from_canonical_json(answer["log"].to_string().as_bytes()).ok()?;
        // The command refuses an answer that occurs twice.
        if logs.insert(answer["instance"].as_str()?.to_owned(), log).is_some() {
            return None;
        }
    }
    let kept = Kept {
        commitment: Some(serde_json::from_value(documents["early"].clone()).ok()?),
        pool: Some(serde_json::from_value(documents["late"].clone()).ok()?),
        logs: Some(logs),
        heads: page.head.into_iter().collect(),
        log: page.receipts,
        boards: vec![documents["board"].clone()],
        ..Kept::default()
    };
    Some(verify(&reveal, &kept).unwrap().breaches.iter().map(ToString::to_string).collect())
}

/// Lists the fields of a document, each kind once: the first of a list stands for the others. Returns the kind and the
/// pointer.
fn fields(document: &Value) -> Vec<(String, String)> {
    fn walk(value: &Value, place: &str, pointer: &str, all: &mut BTreeMap<String, String>) {
        if !place.is_empty() {
            all.entry(place.to_owned()).or_insert_with(|| pointer.to_owned());
        }
        match value {
            // One change stands for all within a specification or a log: its hash covers it whole.
            _ if ["/task", "/log"].iter().any(|whole| place.ends_with(whole)) => {}
            Value::Object(members) => {
                for (name, member) in members {
                    let escaped = name.replace('~', "~0").replace('/', "~1");
                    walk(member, &format!("{place}/{name}"), &format!("{pointer}/{escaped}"), all);
                }
            }
            Value::Array(items) => {
                for (i, item) in items.iter().enumerate() {
                    walk(item, &format!("{place}/*"), &format!("{pointer}/{i}"), all);
                }
            }
            _ => {}
        }
    }
    let mut all = BTreeMap::new();
    walk(document, "", "", &mut all);
    all.into_iter().collect()
}

/// Returns the document with a field changed, removed, and exchanged with its neighbour.
fn changes_of(document: &Value, pointer: &str) -> Vec<(&'static str, Value)> {
    let (parent, own) = pointer.rsplit_once('/').unwrap();
    let mut all = Vec::new();
    let mut changed = document.clone();
    *changed.pointer_mut(pointer).unwrap() = other(document.pointer(pointer).unwrap());
    all.push(("changed", changed));
    let mut removed = document.clone();
    let mut exchanged = document.clone();
    match (removed.pointer_mut(parent).unwrap(), exchanged.pointer_mut(parent).unwrap()) {
        (Value::Object(members), Value::Object(siblings)) => {
            members.remove(&own.replace("~1", "/").replace("~0", "~"));
            let alike: BTreeSet<String> = siblings
                .iter()
                .filter(|(name, value)| *name != own && kind(value) == kind(&siblings[own]) && **value != siblings[own])
                .map(|(name, _)| name.clone())
                .collect();
            if let Some(name) = alike.first() {
                let (one, two) = (siblings[own].clone(), siblings[name].clone());
                siblings.insert(own.to_owned(), two);
                siblings.insert(name.clone(), one);
                all.push(("exchanged with its neighbour", exchanged));
            }
        }
        (Value::Array(items), Value::Array(siblings)) => {
            let at: usize = own.parse().unwrap();
            items.remove(at);
            if let Some(next) = (at + 1..siblings.len()).find(|next| siblings[*next] != siblings[at]) {
                siblings.swap(at, next);
                all.push(("exchanged with the next", exchanged));
            }
            let mut replayed = document.clone();
            let items = replayed.pointer_mut(parent).unwrap().as_array_mut().unwrap();
            items.push(items[at].clone());
            all.push(("replayed", replayed));
        }
        _ => unreachable!("a field has a parent"),
    }
    all.push(("removed", removed));
    all.retain(|(_, changed)| changed != document);
    all
}

fn kind(value: &Value) -> std::mem::Discriminant<Value> {
    std::mem::discriminant(value)
}

/// Returns another value of the same kind.
fn other(value: &Value) -> Value {
    match value {
        Value::Null => json!("something"),
        Value::Bool(is) => json!(!is),
        Value::Number(number) => {
            number.as_i64().map_or_else(|| json!(number.as_f64().unwrap() + 0.25), |n| json!(n + 1))
        }
        Value::String(text) => {
            let last = text.chars().last().map_or('0', |last| if last == '0' { '1' } else { '0' });
            let mut changed: String = text.chars().take(text.chars().count().saturating_sub(1)).collect();
            changed.push(last);
            json!(changed)
        }
        Value::Array(_) => json!([]),
        Value::Object(_) => json!({}),
    }
}
