//! Workers: take jobs under a lease, grade them on separate threads, and store the reports.
//!
//! No transaction is open during grading. A worker that is asked to stop gives its job back unfinished, without
//! counting the attempt. If a worker dies, its lease expires.

mod outcomes;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::app::grading::{Cores, Unfinished, execute};
use crate::clock::steady::steady_now_ms;
use crate::store::claims::Claimed;
use crate::store::job_ends::MAX_ATTEMPTS;
use crate::store::jobs::{Claim, HiddenJob};
use crate::store::queue::Lane;
use crate::store::reports::{GRADER, PackedReport};
use crate::store::{Store, StoreResult};
use crate::threads::yield_to_others;
use outcomes::Outcome;
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::grading::{Report, grade_hashed};
use plumbline_engine::hidden::receipts::{Graded, OfInstance, Signed, Signer, receipt};
use plumbline_engine::tasks::catalogue::Catalogue;

/// Settings of the workers.
#[derive(Debug, Clone, Copy)]
pub struct WorkerSettings {
    /// Number of jobs graded at the same time, in addition to one quick job and one answer to a hidden instance.
    pub workers: usize,
    /// Time after which a lease expires unless it is renewed; leases are renewed every third of it.
    pub lease: Duration,
    /// Time limit of one grading.
    pub deadline: Duration,
}

/// Number of quick jobs that a worker takes at once; together they take some tens of milliseconds.
const QUICK_JOBS: usize = 64;
/// Interval at which an idle worker looks for expired leases, and for jobs of which no notice came; at random up to
/// half as long again, so that nodes that start together do not look together.
const IDLE_LOOK: Duration = Duration::from_millis(400);
/// Pause after a failure of the database.
const ERROR_PAUSE: Duration = Duration::from_secs(1);

/// Time after which a failure that lasts is logged again.
const TOLD_AGAIN: Duration = Duration::from_mins(1);

/// Niceness of the thread that grades answers to hidden instances: the duration of such a grading must not show in how
/// fast others are served.
const HIDDEN_NICENESS: i32 = 10;

/// The workers of one process.
#[derive(Debug)]
pub struct Workers {
    stop: CancellationToken,
    running: TaskTracker,
}

impl Workers {
    /// Starts the workers: the configured number, one reserved for quick jobs, and one for answers to hidden instances.
    /// `signer` signs a receipt of every grade.
    ///
    /// # Errors
    /// Returns an error if a thread cannot be started.
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
    /// Lanes in which it looks for jobs, in this order.
    lanes: &'static [Lane],
    /// Separate grading thread of the hidden lane, whose work must not be observable.
    apart: Option<Arc<rayon::ThreadPool>>,
    signer: Arc<Signer>,
    stop: CancellationToken,
}

/// Counts a worker as busy in the metrics until dropped.
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

/// Outcome of a grading.
enum Ending {
    Graded(Box<PackedReport>, Duration),
    Stopped,
    Unreadable(String),
    Panicked,
}

impl Worker {
    /// Runs until asked to stop, and starts again if a panic of ours ends the loop.
    async fn keep_running(self) {
        while let Err(error) = tokio::spawn(self.clone().run()).await {
            tracing::error!(%error, "a worker failed and starts again");
            self.pause(ERROR_PAUSE).await;
        }
    }

    async fn run(self) {
        // The failure to look for jobs that was told last, while it lasts.
        let mut told: Option<(String, Instant)> = None;
        while !self.stop.is_cancelled() {
            // Listen before looking, so that a job added in between wakes this worker.
            let woken = self.store.queued().notified();
            tokio::pin!(woken);
            woken.as_mut().enable();
            match self.store.claim(self.lanes, duration_ms(self.settings.lease), QUICK_JOBS).await {
                Ok(Claimed::Jobs(claims)) => {
                    let first = claims.first().map(|claim| claim.submission_id.clone()).unwrap_or_default();
                    let _busy = self.is_seen().then(Busy::begin);
                    if let Err(error) = self.work(claims).await {
                        // The leases expire and the jobs are taken again.
                        tracing::error!(%error, first, "could not record the end of jobs");
                        self.pause(ERROR_PAUSE).await;
                    }
                }
                Ok(Claimed::GivenUp) => self.count_error(),
                Ok(Claimed::Nothing) => {
                    tokio::select! {
                        () = woken => {}
                        () = tokio::time::sleep(IDLE_LOOK.mul_f64(1.0 + jitter() / 2.0)) => {}
                        () = self.stop.cancelled() => {}
                    }
                }
                Err(error) => {
                    let what = error.to_string();
                    if told.as_ref().is_none_or(|(before, at)| *before != what || at.elapsed() > TOLD_AGAIN) {
                        tracing::error!(error = what, "could not look for jobs");
                        told = Some((what, Instant::now()));
                    }
                    self.pause(ERROR_PAUSE).await;
                    continue;
                }
            }
            told = None;
        }
    }

    /// Returns whether its work shows in metrics. Metrics of the hidden lane would reveal when an answer is graded, and
    /// how long that takes.
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

    /// Grades jobs and records their outcomes, and renews their leases until both are done.
    async fn work(&self, claims: Vec<Claim>) -> StoreResult<()> {
        let is_lost = Arc::new(AtomicBool::new(false));
        let claims: Arc<[Claim]> = claims.into();
        let working = async {
            let endings = self.grade(&claims, Arc::clone(&is_lost)).await?;
            self.conclude(&claims, endings, is_lost.load(Ordering::Relaxed)).await
        };
        // Renew beside the work and not between its steps: there is only one write connection, and a renewal must not
        // wait for it while the work that holds it waits for the renewal.
        let beating = async {
            let mut heartbeat = tokio::time::interval(self.settings.lease / 3);
            heartbeat.tick().await;
            loop {
                heartbeat.tick().await;
                for claim in &*claims {
                    // A failed renewal is not a lost lease: recording decides in the end. If one of several quick jobs
                    // is lost, the others go on, because each is recorded separately.
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

    /// Records the outcomes of jobs.
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
                Ending::Stopped if self.stop.is_cancelled() => {
                    self.record(Outcome::GivenBack(claim, false)).await?;
                }
                Ending::Stopped => {
                    let limit = self.settings.deadline.as_secs();
                    _ = self.fail(claim, &format!("grading took longer than the limit of {limit} s")).await?;
                }
                Ending::Unreadable(cause) => {
                    tracing::error!(submission = claim.submission_id, cause, "a stored submission cannot be graded");
                    let has_ended = self.fail(claim, claim.why_unreadable()).await?;
                    if has_ended && self.is_seen() {
                        metrics::counter!("plumbline_corrupt_rows_total").increment(1);
                    }
                }
                Ending::Panicked if claim.attempt < MAX_ATTEMPTS => {
                    self.record(Outcome::GivenBack(claim, true)).await?;
                }
                Ending::Panicked => _ = self.fail(claim, "the grader failed on this submission").await?,
            }
        }
        if !graded.is_empty() {
            let recorded = self.record(Outcome::Graded(&mut graded)).await?;
            if self.is_seen() {
                metrics::counter!("plumbline_graded_total").increment(recorded as u64);
                self.store.note_graded(recorded);
            }
        }
        Ok(())
    }

    async fn fail(&self, claim: &Claim, why: &str) -> StoreResult<bool> {
        // Another attempt may hold the job, and grade it.
        let has_ended = self.record(Outcome::Failed(claim, why)).await? > 0;
        if has_ended {
            self.count_error();
            tracing::error!(submission = claim.submission_id, why, "a submission ended as grader_error");
        }
        Ok(has_ended)
    }

    /// Grades jobs on a thread that may block, until all are graded or the worker is asked to stop.
    ///
    /// # Errors
    /// Returns an error if the database fails; the jobs are taken again when their leases have expired.
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
            // The receiver may be gone.
            let _ = done.send(endings);
        };
        match &self.apart {
            Some(apart) => apart.spawn(work),
            None => drop(tokio::task::spawn_blocking(work)),
        }
        Ok(is_done.await.unwrap_or_else(|error| {
            tracing::error!(%error, "a grading thread ended without a result");
            claims.iter().map(|_| Ending::Panicked).collect()
        }))
    }
}

/// Grades one job and signs a receipt of the result.
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
                // Answers to hidden instances get no fingerprint: each instance is issued only once, so there is
                // nothing to compare.
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
        // A clock that is behind signs no grade that is older than its answer.
        graded_at_ms: steady_now_ms().max(job.hidden.as_ref().map_or(i64::MIN, |hidden| hidden.answered_at_ms)),
        hidden: job.hidden.as_ref().map(|hidden| OfInstance {
            epoch: &hidden.epoch_id,
            instance: &hidden.instance_id,
            salt: &hidden.salt,
        }),
    };
    signer.sign(&receipt(&graded, report))
}

/// Returns a number from 0 to 1 that differs between calls and nodes.
fn jitter() -> f64 {
    f64::from(uuid::Uuid::new_v4().as_fields().0) / f64::from(u32::MAX)
}

fn duration_ms(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}
