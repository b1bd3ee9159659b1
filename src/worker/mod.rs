//! Workers: take jobs under a lease, grade them on threads of their own, and bring the reports back.
//!
//! No transaction is open while grading. A worker that is asked to stop gives its job back unfinished, without
//! counting the attempt; one that dies leaves a lease that runs out.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::app::grading::{Cores, Unfinished, execute};
use crate::clock::now_ms;
use crate::store::jobs::{Claim, Claimed, HiddenJob, MAX_ATTEMPTS};
use crate::store::queue::Lane;
use crate::store::reports::{GRADER, PackedReport};
use crate::store::submissions::SubmissionState;
use crate::store::{Store, StoreResult};
use crate::threads::yield_to_others;
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::grading::{Report, grade_hashed};
use plumbline_engine::hidden::receipts::{Graded, OfInstance, Signed, Signer, receipt};
use plumbline_engine::tasks::catalogue::Catalogue;

/// How workers work.
#[derive(Debug, Clone, Copy)]
pub struct WorkerSettings {
    /// Jobs graded at the same time, beside one quick one and one answer to a hidden instance.
    pub workers: usize,
    /// How long a lease lasts unless it is renewed; renewed three times as often.
    pub lease: Duration,
    /// How long one grading may take.
    pub deadline: Duration,
}

/// Quick jobs that a worker takes at once: together they take some tens of milliseconds.
const QUICK_JOBS: usize = 64;
/// How often an idle worker looks for leases that ran out.
const IDLE_LOOK: Duration = Duration::from_millis(500);
/// Pause after the database failed.
const ERROR_PAUSE: Duration = Duration::from_secs(1);

/// How much the thread that grades answers to hidden instances yields to others (niceness): how long it takes shall not show in how
/// fast others are served.
const HIDDEN_NICENESS: i32 = 10;

/// The workers of one process.
#[derive(Debug)]
pub struct Workers {
    stop: CancellationToken,
    running: TaskTracker,
}

impl Workers {
    /// Starts the workers: as many as the settings say, one that is kept for quick jobs, and one for answers to hidden instances.
    /// `signer` signs a receipt of every grade.
    ///
    /// # Errors
    /// Where there is no thread to be had.
    pub fn start(store: &Store, settings: WorkerSettings, signer: &Arc<Signer>) -> anyhow::Result<Self> {
        let stop = CancellationToken::new();
        let running = TaskTracker::new();
        let apart = rayon::ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "grade-hidden".to_owned());
        let apart = Arc::new(
            apart
                .start_handler(|_| yield_to_others(HIDDEN_NICENESS))
                .panic_handler(|_panic| tracing::error!("a grading thread panicked"))
                .build()?,
        );
        let start = |lanes: &'static [Lane], apart: Option<Arc<rayon::ThreadPool>>| {
            let signer = Arc::clone(signer);
            let worker = Worker { store: store.clone(), settings, lanes, apart, signer, stop: stop.clone() };
            running.spawn(worker.keep_running());
        };
        for _ in 0..settings.workers {
            start(&[Lane::Long, Lane::Quick], None);
        }
        start(&[Lane::Quick], None);
        start(&[Lane::Hidden], Some(apart));
        running.close();
        metrics::gauge!("plumbline_workers").set((settings.workers + 1) as f64);
        metrics::gauge!("plumbline_workers_busy").set(0.0);
        Ok(Self { stop, running })
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
    /// Where it looks for jobs, in this order.
    lanes: &'static [Lane],
    /// A thread of its own to grade on, where what it does shall not be seen.
    apart: Option<Arc<rayon::ThreadPool>>,
    signer: Arc<Signer>,
    stop: CancellationToken,
}

/// A worker that has jobs, for the metric of those.
struct Busy;

impl Busy {
    fn begin() -> Self {
        metrics::gauge!("plumbline_workers_busy").increment(1.0);
        Self
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        metrics::gauge!("plumbline_workers_busy").decrement(1.0);
    }
}

/// How a grading ended.
enum Ending {
    Graded(Box<PackedReport>, Duration),
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
            let woken = self.store.queued().notified();
            tokio::pin!(woken);
            woken.as_mut().enable();
            match self.store.claim(self.lanes, duration_ms(self.settings.lease), QUICK_JOBS).await {
                Ok(Claimed::Jobs(claims)) => {
                    let first = claims.first().map(|claim| claim.submission_id.clone()).unwrap_or_default();
                    let _busy = self.is_seen().then(Busy::begin);
                    if let Err(error) = self.work(claims).await {
                        // The leases run out and the jobs are taken again.
                        tracing::error!(%error, first, "could not record the end of jobs");
                        self.pause(ERROR_PAUSE).await;
                    }
                }
                Ok(Claimed::GivenUp) => self.count_error(),
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

    /// Whether metrics tell what it does: of answers to hidden instances they would tell when one is graded, and how long that takes.
    const fn is_seen(&self) -> bool {
        self.apart.is_none()
    }

    fn count_error(&self) {
        if self.is_seen() {
            metrics::counter!("plumbline_grader_errors_total").increment(1);
        }
    }

    async fn pause(&self, duration: Duration) {
        tokio::select! {
            () = tokio::time::sleep(duration) => {}
            () = self.stop.cancelled() => {}
        }
    }

    /// Grades jobs and records how they ended, with their leases renewed until both are done.
    async fn work(&self, claims: Vec<Claim>) -> StoreResult<()> {
        let is_lost = Arc::new(AtomicBool::new(false));
        let claims: Arc<[Claim]> = claims.into();
        let working = async {
            let endings = self.grade(&claims, Arc::clone(&is_lost)).await?;
            self.conclude(&claims, endings, is_lost.load(Ordering::Relaxed)).await
        };
        // Beside the work and not between its steps: there is one connection that writes, and renewing must not wait for
        // it while the work that holds it waits for the renewal.
        let beating = async {
            let mut heartbeat = tokio::time::interval(self.settings.lease / 3);
            heartbeat.tick().await;
            loop {
                heartbeat.tick().await;
                for claim in &*claims {
                    // A failed renewal is not a lost lease: recording tells in the end. Of several quick jobs one that is
                    // lost stops none: each is recorded for itself.
                    let renewed = self.store.renew(claim, duration_ms(self.settings.lease)).await;
                    if matches!(renewed, Ok(false)) && claims.len() == 1 {
                        is_lost.store(true, Ordering::Relaxed);
                    }
                }
            }
        };
        tokio::select! {
            done = working => done,
            () = beating => Ok(()),
        }
    }

    async fn conclude(&self, claims: &[Claim], endings: Vec<Ending>, is_lost: bool) -> StoreResult<()> {
        let mut graded = Vec::with_capacity(claims.len());
        for (claim, ending) in claims.iter().zip(endings) {
            match ending {
                Ending::Graded(report, took) => {
                    if self.is_seen() {
                        metrics::histogram!("plumbline_grading_seconds").record(took.as_secs_f64());
                    }
                    graded.push((claim.clone(), *report));
                }
                Ending::Stopped if is_lost => {}
                Ending::Stopped if self.stop.is_cancelled() => self.store.give_back(claim, false).await?,
                Ending::Stopped => {
                    let limit = self.settings.deadline.as_secs();
                    self.fail(claim, &format!("grading took longer than the limit of {limit} s")).await?;
                }
                Ending::Unreadable(cause) => {
                    tracing::error!(submission = claim.submission_id, cause, "a stored submission cannot be graded");
                    self.fail(claim, "the stored submission could not be read").await?;
                }
                Ending::Panicked if claim.attempt < MAX_ATTEMPTS => self.store.give_back(claim, true).await?,
                Ending::Panicked => self.fail(claim, "the grader failed on this submission").await?,
            }
        }
        if !graded.is_empty() {
            let recorded = self.store.record(&graded, now_ms()).await?;
            if self.is_seen() {
                metrics::counter!("plumbline_graded_total").increment(recorded as u64);
                self.store.note_graded(recorded);
            }
        }
        Ok(())
    }

    async fn fail(&self, claim: &Claim, why: &str) -> StoreResult<()> {
        self.count_error();
        self.store.fail(claim, SubmissionState::GraderError, why, now_ms()).await
    }

    /// Grades on a thread where it may take long, until all are graded or it is asked to stop.
    ///
    /// # Errors
    /// Where the database fails; the jobs are taken again when their leases have run out.
    async fn grade(&self, claims: &Arc<[Claim]>, is_lost: Arc<AtomicBool>) -> StoreResult<Vec<Ending>> {
        let mut catalogue = self.store.catalogue();
        if claims.iter().any(|claim| claim.hidden.is_none() && catalogue.suite(&claim.suite_id).is_none()) {
            // Another process may have added the suite.
            catalogue = self.store.current_catalogue().await?;
        }
        let jobs = Arc::clone(claims);
        let stop = self.stop.clone();
        let deadline = self.settings.deadline;
        let signer = Arc::clone(&self.signer);
        let (done, is_done) = oneshot::channel();
        let work = move || {
            let asked = || is_lost.load(Ordering::Relaxed) || stop.is_cancelled();
            let endings: Vec<Ending> =
                jobs.iter().map(|job| grade_one(job, &catalogue, &signer, &asked, deadline)).collect();
            // Whoever waited for it may have gone.
            let _ = done.send(endings);
        };
        match &self.apart {
            Some(apart) => apart.spawn(work),
            None => drop(tokio::task::spawn_blocking(work)),
        }
        Ok(is_done.await.unwrap_or_else(|error| {
            tracing::error!(%error, "a grading thread broke");
            claims.iter().map(|_| Ending::Panicked).collect()
        }))
    }
}

/// Grades one job, and signs what was found.
fn grade_one(
    job: &Claim,
    catalogue: &Catalogue,
    signer: &Signer,
    asked: &(dyn Fn() -> bool + Sync),
    deadline: Duration,
) -> Ending {
    let begun = Instant::now();
    let stop = || asked() || begun.elapsed() >= deadline;
    if asked() {
        return Ending::Stopped;
    }
    let log = match job.read_log() {
        Ok(log) => log,
        Err(error) => return Ending::Unreadable(error.to_string()),
    };
    let hidden = match job.hidden.as_ref().map(HiddenJob::read_task).transpose() {
        Ok(hidden) => hidden,
        Err(error) => return Ending::Unreadable(error.to_string()),
    };
    let found = match &hidden {
        Some((task, hash)) => Some((task, *hash)),
        None => catalogue.suite(&job.suite_id).and_then(|entry| entry.task_numbered(job.task_number)),
    };
    let Some((task, hash)) = found else {
        return Ending::Unreadable(format!("no task {} in {:?}", job.task_number, job.suite_id));
    };
    let graded = execute(Cores::Idle, &stop, |control| grade_hashed(task, hash, &log, control));
    let took = begun.elapsed();
    match graded {
        Ok(report) => match PackedReport::of(&report, i64::try_from(took.as_micros()).unwrap_or(i64::MAX)) {
            Ok(packed) => {
                let packed = packed.with_receipt(sign(job, &report, signer));
                // Of hidden answers nobody has the same, so there is nothing to compare.
                let packed = match job.hidden {
                    None => packed.with_fingerprint(&Fingerprint::of(hash, &log)),
                    Some(_) => packed,
                };
                Ending::Graded(Box::new(packed), took)
            }
            Err(error) => Ending::Unreadable(error.to_string()),
        },
        Err(Unfinished::Stopped) => Ending::Stopped,
        Err(Unfinished::Panicked) => {
            tracing::error!(submission = job.submission_id, attempt = job.attempt, "grading panicked");
            Ending::Panicked
        }
    }
}

fn sign(job: &Claim, report: &Report, signer: &Signer) -> Signed {
    let graded = Graded {
        submission: &job.submission_id,
        attempt: job.attempt,
        suite: &job.suite_id,
        log_hash: &job.log_hash,
        grader: GRADER,
        graded_at_ms: now_ms(),
        hidden: job.hidden.as_ref().map(|hidden| OfInstance {
            epoch: &hidden.epoch_id,
            instance: &hidden.instance_id,
            salt: &hidden.salt,
        }),
    };
    signer.sign(&receipt(&graded, report))
}

fn duration_ms(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}
