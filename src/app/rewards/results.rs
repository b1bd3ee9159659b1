//! Results of grading, and a cache of them by what was graded.

use std::sync::Arc;

use quick_cache::Weighter;
use quick_cache::sync::Cache;

use super::given_task::GivenTask;
use super::request::Detail;
use crate::app::error::AppResult;
use plumbline_engine::grading::{Report, Scores};
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;

/// What is to be graded.
#[derive(Debug)]
pub struct Work {
    /// Task to grade against.
    pub given: GivenTask,
    /// Log to grade.
    pub log: BlockLog,
    /// SHA-256 of the log's canonical JSON, in hex.
    pub log_hash: String,
    /// Whether a report is asked for, or only scores.
    pub detail: Detail,
}

impl Work {
    /// Returns the task and its hash.
    ///
    /// # Errors
    /// Returns the error of [`GivenTask::task`].
    pub fn task(&self) -> AppResult<(&Task, &str)> {
        self.given.task()
    }
}

/// What grading found.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The scores.
    pub scores: Arc<Scores>,
    /// The report, if it was asked for.
    pub report: Option<Arc<Report>>,
}

impl From<Scores> for Outcome {
    fn from(scores: Scores) -> Self {
        Self { scores: Arc::new(scores), report: None }
    }
}

impl From<Report> for Outcome {
    fn from(report: Report) -> Self {
        Self { scores: Arc::new(Scores::from(&report)), report: Some(Arc::new(report)) }
    }
}

/// Hashes of log and task. The version of the checks is that of the program.
type Key = (Box<str>, Box<str>);

#[derive(Debug, Clone)]
struct ByMemory;

impl Weighter<Key, Outcome> for ByMemory {
    fn weight(&self, key: &Key, outcome: &Outcome) -> u64 {
        let report = outcome.report.as_ref().map_or(0, |report| report.memory_bytes());
        (outcome.scores.memory_bytes() + report + key.0.len() + key.1.len()) as u64
    }
}

/// Results that are kept, up to an amount of memory.
#[derive(Debug)]
pub struct Results {
    cache: Cache<Key, Outcome, ByMemory>,
}

impl Results {
    /// Keeps results in `bytes` of memory.
    #[must_use]
    pub fn within(bytes: usize) -> Self {
        // What scores take.
        const TYPICAL_BYTES: usize = 1 << 10;
        Self { cache: Cache::with_weighter(bytes.div_ceil(TYPICAL_BYTES), bytes as u64, ByMemory) }
    }

    /// Returns the result for this work, if one with the detail that is asked for is kept.
    #[must_use]
    pub fn get(&self, work: &Work, task_hash: &str) -> Option<Outcome> {
        let found = self.cache.get(&key(work, task_hash));
        let found = found.filter(|found| work.detail == Detail::Scores || found.report.is_some());
        let outcome = if found.is_some() { "hit" } else { "miss" };
        metrics::counter!("plumbline_grade_cache_total", "outcome" => outcome).increment(1);
        found
    }

    /// Keeps the result for this work.
    pub fn keep(&self, work: &Work, task_hash: &str, outcome: &Outcome) {
        self.cache.insert(key(work, task_hash), outcome.clone());
        metrics::gauge!("plumbline_grade_cache_bytes").set(self.cache.weight() as f64);
    }
}

fn key(work: &Work, task_hash: &str) -> Key {
    (Box::from(work.log_hash.as_str()), Box::from(task_hash))
}
