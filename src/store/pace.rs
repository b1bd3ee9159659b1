//! Pace of the queue: mean time per graded job in this process, for estimates of waiting times.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest pause that counts; a longer one is idleness and says nothing about the pace.
const IDLE: Duration = Duration::from_secs(5);
/// Weight of the newest value in the moving mean.
const NEWEST: f64 = 0.1;

/// Pace as an exponential moving mean.
#[derive(Debug, Default)]
pub(super) struct Pace {
    state: Mutex<(Option<Instant>, Option<f64>)>,
}

impl Pace {
    /// Records that this number of jobs ended now.
    pub fn note(&self, jobs: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if let Some(since) = state.0.map(|last| now - last).filter(|since| *since < IDLE && jobs > 0) {
            let newest = since.as_secs_f64() / jobs as f64;
            state.1 = Some(state.1.map_or(newest, |mean| mean + NEWEST * (newest - mean)));
        }
        state.0 = Some(now);
    }

    /// Returns the mean time between the ends of two jobs, in seconds.
    pub fn seconds_a_job(&self) -> Option<f64> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).1
    }
}
