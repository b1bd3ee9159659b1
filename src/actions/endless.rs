//! Results of scripts that ran out of processor time. A trainer whose request took too long sends the script again, and
//! need not wait as long the second time.

use std::time::{Duration, Instant};

use quick_cache::sync::Cache;
use sha2::{Digest as _, Sha256};

use super::job::{Answer, Job};

/// SHA-256 of a job.
pub(super) type Hash = [u8; 32];

/// Number of results that are kept.
const MAX_RESULTS: usize = 512;
/// Greatest length in bytes of a result that is kept, as JSON: it may hold a whole world.
const MAX_BYTES: usize = 64 << 10;
/// Greatest number of events and of blocks of a result whose length is looked at.
const MAX_ITEMS: usize = 2_000;
/// Time for which a result is kept. A crowded machine may have stopped a script that an idle one lets end.
const KEPT_FOR: Duration = Duration::from_mins(10);

/// Results of jobs that were stopped for their time, each for a while.
#[derive(Debug)]
pub(super) struct Endless {
    kept: Cache<Hash, (Instant, Answer)>,
}

impl Endless {
    pub fn new() -> Self {
        Self { kept: Cache::new(MAX_RESULTS) }
    }

    /// Returns the hash of a job.
    ///
    /// # Errors
    /// Returns an error if the job cannot be written as JSON.
    pub fn hash(job: &Job) -> anyhow::Result<Hash> {
        Ok(Sha256::digest(serde_json::to_vec(job)?).into())
    }

    /// Returns the result of a job that was stopped not long ago.
    pub fn known(&self, job: &Hash, now: Instant) -> Option<Answer> {
        let (since, answer) = self.kept.get(job)?;
        (now.duration_since(since) < KEPT_FOR).then_some(answer)
    }

    /// Keeps a result, if the job was stopped for its time and the result is small.
    ///
    /// # Errors
    /// Returns an error if the result cannot be written as JSON.
    pub fn keep(&self, job: Hash, answer: &Answer, now: Instant) -> anyhow::Result<()> {
        let is_stopped = answer.stopped().is_some_and(|stopped| stopped.limit == "time");
        let events: usize = answer.turns.iter().map(|turn| turn.events.len()).sum();
        let stands = answer.end.as_ref().map_or(0, |end| end.standing().count());
        // Writing a large result takes time.
        if is_stopped && events + stands <= MAX_ITEMS {
            let bytes = serde_json::to_vec(answer)?.len();
            if bytes <= MAX_BYTES {
                self.kept.insert(job, (now, answer.clone()));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actions::{LimitReached, Replayed};

    fn stopped(limit: &str, log_bytes: usize) -> Answer {
        let stopped = Some(LimitReached { limit: limit.to_owned(), detail: "a".repeat(log_bytes) });
        Answer { turns: vec![Replayed { stopped, ..Replayed::default() }], ..Answer::default() }
    }

    #[test]
    fn small_results_of_endless_scripts_are_kept_for_a_while() {
        let (endless, now) = (Endless::new(), Instant::now());
        for (number, answer, is_kept) in [
            (1, stopped("time", 10), true),
            (2, stopped("time", MAX_BYTES), false),
            (3, stopped("events", 10), false),
            (4, Answer::default(), false),
        ] {
            let hash = [number; 32];
            endless.keep(hash, &answer, now).unwrap();
            assert_eq!(endless.known(&hash, now).is_some(), is_kept, "{number}");
            assert!(endless.known(&hash, now + KEPT_FOR).is_none());
        }
    }
}
