//! Outcomes of jobs, recorded however long the database refuses: the work is done, and its leases are renewed meanwhile.
//!
//! Otherwise a disk that fails now and then would use up the attempts of good jobs.

use std::time::{Duration, Instant};

use super::{ERROR_PAUSE, Worker};
use crate::clock::now_ms;
use crate::store::StoreResult;
use crate::store::jobs::Claim;
use crate::store::reports::PackedReport;
use crate::store::states::SubmissionState;

/// Time for which recording is tried. Then the leases expire, and others take the jobs.
const PATIENCE: Duration = Duration::from_mins(1);
/// First pause before recording is tried again; each is twice as long as the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(50);

/// What becomes of one or more jobs.
#[derive(Debug)]
pub(super) enum Outcome<'a> {
    /// They have reports.
    Graded(&'a mut [(Claim, PackedReport)]),
    /// It ends without a report, for this reason.
    Failed(&'a Claim, &'a str),
    /// It is given back. Says whether the attempt counts.
    GivenBack(&'a Claim, bool),
}

impl Worker {
    /// Records an outcome, and tries again until it succeeds or the worker is asked to stop. Returns the number of
    /// submissions that ended by it.
    pub(super) async fn record(&self, mut outcome: Outcome<'_>) -> StoreResult<usize> {
        let begun = Instant::now();
        let mut pause = FIRST_PAUSE;
        loop {
            match self.record_once(&mut outcome).await {
                Err(error) if begun.elapsed() < PATIENCE && !self.stop.is_cancelled() => {
                    tracing::warn!(%error, "could not record the end of jobs, and tries again");
                    self.pause(pause).await;
                    pause = (2 * pause).min(ERROR_PAUSE);
                }
                ended => return ended,
            }
        }
    }

    async fn record_once(&self, outcome: &mut Outcome<'_>) -> StoreResult<usize> {
        match outcome {
            Outcome::Graded(graded) => self.store.record(graded, now_ms()).await,
            Outcome::Failed(claim, why) => {
                self.store.fail(claim, SubmissionState::GraderError, why, now_ms()).await.map(usize::from)
            }
            Outcome::GivenBack(claim, attempt_counts) => self.store.give_back(claim, *attempt_counts).await.map(|()| 0),
        }
    }
}
