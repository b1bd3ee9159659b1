//! Workers: take jobs under a lease, grade them on threads of their own, and bring the reports back.
//!
//! No transaction is open while grading. A worker that is asked to stop gives its job back unfinished, without
//! counting the attempt; one that dies leaves a lease that runs out.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::clock::now_ms;
use crate::elasticity::Control;
use crate::grading::{Report, grade_log};
use crate::store::jobs::{Claim, Claimed, MAX_ATTEMPTS};
use crate::store::submissions::SubmissionState;
use crate::store::{Store, StoreResult};

/// How workers work.
#[derive(Debug, Clone, Copy)]
pub struct WorkerSettings {
    /// Jobs graded at the same time.
    pub workers: usize,
    /// How long a lease lasts unless it is renewed; renewed three times as often.
    pub lease: Duration,
    /// How long one grading may take.
    pub deadline: Duration,
}

/// How often an idle worker looks for leases that ran out.
const IDLE_LOOK: Duration = Duration::from_millis(500);
/// Pause after the database failed.
const ERROR_PAUSE: Duration = Duration::from_secs(1);

/// The workers of one process.
#[derive(Debug)]
pub struct Workers {
    stop: CancellationToken,
    running: TaskTracker,
}

impl Workers {
    /// Starts the workers. `wake` tells them that there may be work.
    #[must_use]
    pub fn start(store: &Store, settings: WorkerSettings, wake: &Arc<Notify>) -> Self {
        let stop = CancellationToken::new();
        let running = TaskTracker::new();
        for _ in 0..settings.workers {
            let worker = Worker { store: store.clone(), settings, wake: Arc::clone(wake), stop: stop.clone() };
            running.spawn(worker.keep_running());
        }
        running.close();
        Self { stop, running }
    }

    /// Asks the workers to stop, and waits until they have given their jobs back.
    pub async fn shut_down(&self) {
        self.stop.cancel();
        self.running.wait().await;
    }
}

#[derive(Clone)]
struct Worker {
    store: Store,
    settings: WorkerSettings,
    wake: Arc<Notify>,
    stop: CancellationToken,
}

/// How a grading ended.
enum Ending {
    Graded(Box<Report>, Duration),
    Stopped,
    Unreadable(String),
    Panicked,
}

impl Worker {
    /// Runs until asked to stop; should a fault of ours break the loop, begins it again.
    async fn keep_running(self) {
        while let Err(error) = tokio::spawn(self.clone().run()).await {
            tracing::error!(%error, "a worker broke and begins again");
            self.pause(ERROR_PAUSE).await;
        }
    }

    async fn run(self) {
        while !self.stop.is_cancelled() {
            // Listening begins before looking, so that work added in between wakes this worker.
            let woken = self.wake.notified();
            tokio::pin!(woken);
            woken.as_mut().enable();
            match self.store.claim(duration_ms(self.settings.lease)).await {
                Ok(Claimed::Job(claim)) => {
                    if let Err(error) = self.work(&claim).await {
                        // The lease runs out and the job is taken again.
                        tracing::error!(%error, submission = claim.submission_id, "could not record the end of a job");
                        self.pause(ERROR_PAUSE).await;
                    }
                }
                Ok(Claimed::GivenUp) => metrics::counter!("plumbline_grader_errors_total").increment(1),
                Ok(Claimed::Nothing) => {
                    tokio::select! {
                        () = woken => {}
                        () = tokio::time::sleep(IDLE_LOOK) => {}
                        () = self.stop.cancelled() => {}
                    }
                }
                Err(error) => {
                    tracing::error!(%error, "could not look for jobs");
                    self.pause(ERROR_PAUSE).await;
                }
            }
        }
    }

    async fn pause(&self, duration: Duration) {
        tokio::select! {
            () = tokio::time::sleep(duration) => {}
            () = self.stop.cancelled() => {}
        }
    }

    /// Grades a job and records how it ended, with the lease renewed until both are done.
    async fn work(&self, claim: &Claim) -> StoreResult<()> {
        let is_lost = Arc::new(AtomicBool::new(false));
        let working = async {
            let ending = self.grade(claim, Arc::clone(&is_lost)).await?;
            self.conclude(claim, ending, is_lost.load(Ordering::Relaxed)).await
        };
        // Beside the work and not between its steps: there is one connection that writes, and renewing must not wait for
        // it while the work that holds it waits for the renewal.
        let beating = async {
            let mut heartbeat = tokio::time::interval(self.settings.lease / 3);
            heartbeat.tick().await;
            loop {
                heartbeat.tick().await;
                // A failed renewal is not a lost lease: recording tells in the end.
                if let Ok(false) = self.store.renew(claim, duration_ms(self.settings.lease)).await {
                    is_lost.store(true, Ordering::Relaxed);
                }
            }
        };
        tokio::select! {
            done = working => done,
            () = beating => Ok(()),
        }
    }

    async fn conclude(&self, claim: &Claim, ending: Ending, is_lost: bool) -> StoreResult<()> {
        match ending {
            Ending::Graded(report, took) => {
                metrics::histogram!("plumbline_grading_seconds").record(took.as_secs_f64());
                let took_us = i64::try_from(took.as_micros()).unwrap_or(i64::MAX);
                if self.store.record(claim, &report, took_us, now_ms()).await? {
                    metrics::counter!("plumbline_graded_total").increment(1);
                }
                Ok(())
            }
            Ending::Stopped if is_lost => Ok(()),
            Ending::Stopped if self.stop.is_cancelled() => self.store.give_back(claim, false).await,
            Ending::Stopped => {
                let limit = self.settings.deadline.as_secs();
                self.fail(claim, &format!("grading took longer than the limit of {limit} s")).await
            }
            Ending::Unreadable(cause) => {
                tracing::error!(submission = claim.submission_id, cause, "a stored submission cannot be graded");
                self.fail(claim, "the stored submission could not be read").await
            }
            Ending::Panicked if claim.attempt < MAX_ATTEMPTS => self.store.give_back(claim, true).await,
            Ending::Panicked => self.fail(claim, "the grader failed on this submission").await,
        }
    }

    async fn fail(&self, claim: &Claim, why: &str) -> StoreResult<()> {
        metrics::counter!("plumbline_grader_errors_total").increment(1);
        self.store.fail(claim, SubmissionState::GraderError, why, now_ms()).await
    }

    /// Grades on a thread where it may take long, until it ends or is asked to stop.
    ///
    /// # Errors
    /// Where the database fails; the job is taken again when its lease has run out.
    async fn grade(&self, claim: &Claim, is_lost: Arc<AtomicBool>) -> StoreResult<Ending> {
        let mut entry = self.store.catalogue().suite(&claim.suite_id).cloned();
        if entry.is_none() {
            // Another process may have added the suite.
            entry = self.store.current_catalogue().await?.suite(&claim.suite_id).cloned();
        }
        let Some(entry) = entry else { return Ok(Ending::Unreadable(format!("no suite {:?}", claim.suite_id))) };
        let job = claim.clone();
        let stop = self.stop.clone();
        let begun = Instant::now();
        let deadline = begun + self.settings.deadline;
        let work = tokio::task::spawn_blocking(move || {
            let asked = || is_lost.load(Ordering::Relaxed) || stop.is_cancelled() || Instant::now() >= deadline;
            let control = Control { join: Some(&both_at_once), ..Control::until(&asked) };
            let log = match job.read_log() {
                Ok(log) => log,
                Err(error) => return Ending::Unreadable(error.to_string()),
            };
            let Some((task, _)) = entry.task_numbered(job.task_number) else {
                return Ending::Unreadable(format!("no task {} in {:?}", job.task_number, job.suite_id));
            };
            match grade_log(task, &log, &control) {
                Ok(report) => Ending::Graded(Box::new(report), begun.elapsed()),
                Err(_stopped) => Ending::Stopped,
            }
        });
        Ok(work.await.unwrap_or_else(|error| {
            tracing::error!(%error, submission = claim.submission_id, attempt = claim.attempt, "grading panicked");
            Ending::Panicked
        }))
    }
}

/// Two jobs on the cores that are idle; large structures are shared out with it.
fn both_at_once(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    rayon::join(a, b);
}

fn duration_ms(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}
