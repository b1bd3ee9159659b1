//! How fast the queue moves: the pace of gradings in this process, for estimates.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Pauses longer than this are idleness and tell nothing of the pace.
const IDLE: Duration = Duration::from_secs(5);
/// Weight of the newest figure.
const NEWEST: f64 = 0.1;

/// The pace, as a moving mean.
#[derive(Debug, Default)]
pub(super) struct Pace {
    state: Mutex<(Option<Instant>, Option<f64>)>,
}

impl Pace {
    /// Notes that so many jobs ended now.
    pub fn note(&self, jobs: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if let Some(since) = state.0.map(|last| now - last).filter(|since| *since < IDLE && jobs > 0) {
            let newest = since.as_secs_f64() / jobs as f64;
            state.1 = Some(state.1.map_or(newest, |mean| mean + NEWEST * (newest - mean)));
        }
        state.0 = Some(now);
    }

    /// Seconds between the ends of two jobs.
    pub fn seconds_a_job(&self) -> Option<f64> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).1
    }
}
