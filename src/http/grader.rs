//! Grading within a request: bounded admission, a deadline for each log, and a cache of results by content.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_util::sync::CancellationToken;

use super::limits::LIMITS;
use super::problem::{ApiError, ApiResult};
use super::server::Connections;
use crate::checks::{Check, Criterion};
use crate::elasticity::Control;
use crate::grading::baseline::Baseline;
use crate::grading::{Report, grade_hashed};
use crate::tasks::Task;
use crate::tasks::catalogue::Entry;
use crate::voxel::BlockLog;

/// Events up to which a log without a stress check is graded where its request is answered: it takes less than a
/// millisecond, and handing it over would take as long.
const QUICK_EVENTS: usize = 1_000;
/// Connections up to which that is so. With more, what waits would wait unseen in the queue of the threads that serve, and
/// whoever asks for something else behind it.
const FEW_CONNECTIONS: usize = 256;
/// How much the threads that grade yield to those that serve (niceness).
const GRADING_NICENESS: i32 = 5;
/// Baselines kept: those of all tasks of a few suites.
const BASELINES: usize = 4_096;
/// Memory that a report takes beside its checks, roughly.
const REPORT_BYTES: u64 = 512;
/// Memory that a check of a report takes, roughly: names, arguments, a sentence, witnesses.
const CHECK_BYTES: u64 = 1_024;

/// What a result is kept under: hashes of log and task. Checks are those of the program.
type Key = (Box<str>, Box<str>);

#[derive(Debug, Clone)]
struct ByMemory;

impl Weighter<Key, Arc<Report>> for ByMemory {
    fn weight(&self, _key: &Key, report: &Arc<Report>) -> u64 {
        let checks = report.turns.iter().map(|turn| turn.checks.len() + turn.informational.len()).sum::<usize>();
        REPORT_BYTES + CHECK_BYTES * checks as u64
    }
}

/// A task to grade against, with its hash.
#[derive(Debug, Clone)]
pub enum GivenTask {
    /// Of a suite, by its number.
    Listed(Arc<Entry>, u32),
    /// Brought by the request.
    Inline(Arc<(Task, String)>),
}

impl GivenTask {
    /// One that the request brings.
    #[must_use]
    pub fn inline(task: Task) -> Self {
        let hash = task.content_hash();
        Self::Inline(Arc::new((task, hash)))
    }

    /// The task and its hash.
    ///
    /// # Errors
    /// 500 where the suite has no such number, which was looked up before.
    pub fn task(&self) -> ApiResult<(&Task, &str)> {
        match self {
            Self::Inline(task) => Ok((&task.0, &task.1)),
            Self::Listed(entry, number) => entry
                .task_numbered(*number)
                .ok_or_else(|| ApiError::internal(&format!("{} has no task {number}", entry.suite.id()))),
        }
    }
}

/// Grades logs for requests that wait.
#[derive(Debug)]
pub struct Grader {
    waiting: Arc<Semaphore>,
    batches: Arc<Semaphore>,
    long: Arc<Semaphore>,
    quick: rayon::ThreadPool,
    connections: Connections,
    cache: Option<Cache<Key, Arc<Report>, ByMemory>>,
    /// By hash of the task.
    baselines: Cache<Box<str>, Arc<Baseline>>,
    stop: CancellationToken,
}

/// A report, and whether it was kept from before.
#[derive(Debug, Clone)]
pub struct Graded {
    /// The report.
    pub report: Arc<Report>,
    /// Whether nothing was computed.
    pub is_cached: bool,
}

impl Grader {
    /// With a cache of `cache_bytes`, or none where it is 0.
    ///
    /// # Errors
    /// Where there are no threads to be had.
    pub fn new(cache_bytes: usize, connections: &Connections, stop: CancellationToken) -> anyhow::Result<Self> {
        let typical = (REPORT_BYTES + 5 * CHECK_BYTES) as usize;
        let cache =
            (cache_bytes > 0).then(|| Cache::with_weighter(cache_bytes / typical, cache_bytes as u64, ByMemory));
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let quick = rayon::ThreadPoolBuilder::new().num_threads(cores).start_handler(yield_to_serving);
        Ok(Self {
            waiting: Arc::new(Semaphore::new(LIMITS.grades_waiting)),
            batches: Arc::new(Semaphore::new(LIMITS.grade_batches)),
            long: Arc::new(Semaphore::new(cores)),
            quick: quick.thread_name(|index| format!("grade-{index}")).build()?,
            connections: connections.clone(),
            cache,
            baselines: Cache::new(BASELINES),
            stop,
        })
    }

    /// The same where a request waits: among what takes long, a few at a time.
    ///
    /// # Errors
    /// The same.
    pub async fn baseline_in_turn(self: &Arc<Self>, given: &GivenTask, deadline: Duration) -> ApiResult<()> {
        if given.task().is_ok_and(|(_, hash)| self.baselines.contains_key(hash)) {
            return Ok(());
        }
        let end = Instant::now() + deadline;
        let turn = tokio::time::timeout_at(end.into(), Arc::clone(&self.long).acquire_owned()).await;
        let Ok(Ok(turn)) = turn else { return Err(too_late()) };
        let (grader, given) = (Arc::clone(self), given.clone());
        let work = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            grader.baseline(&given, end.saturating_duration_since(Instant::now()))
        });
        work.await.map_err(|error| ApiError::internal(&error))?.map(|_| ())
    }

    /// What a log that does nothing earns on a task.
    ///
    /// # Errors
    /// 504 where the deadline passes, 503 where the service stops.
    pub fn baseline(&self, given: &GivenTask, deadline: Duration) -> ApiResult<Arc<Baseline>> {
        let (task, hash) = given.task()?;
        if let Some(known) = self.baselines.get(hash) {
            return Ok(known);
        }
        let end = Instant::now() + deadline;
        let stop = || self.stop.is_cancelled() || Instant::now() >= end;
        let work = std::panic::AssertUnwindSafe(|| Baseline::of(task, &Control::until(&stop)));
        let baseline = std::panic::catch_unwind(work)
            .map_err(|_panic| ApiError::internal(&format!("the baseline of {} panicked", task.id)))?
            .map_err(|_stopped| too_late())?;
        let baseline = Arc::new(baseline);
        self.baselines.insert(Box::from(hash), Arc::clone(&baseline));
        Ok(baseline)
    }

    /// A place among those that are graded or wait.
    ///
    /// # Errors
    /// 429 at once where there is none.
    pub fn admit(&self) -> ApiResult<OwnedSemaphorePermit> {
        admitted(&self.waiting, "logs")
    }

    /// A place for a whole batch.
    ///
    /// # Errors
    /// 429 at once where there is none.
    pub fn admit_batch(&self) -> ApiResult<OwnedSemaphorePermit> {
        admitted(&self.batches, "batches")
    }

    /// Grades a log, here where that is quick and else on a thread of its own.
    ///
    /// # Errors
    /// 504 where the deadline passes, 503 where the service stops, 500 where grading fails; never a score.
    pub async fn grade(
        self: &Arc<Self>,
        given: GivenTask,
        log: BlockLog,
        log_hash: &str,
        deadline: Duration,
    ) -> ApiResult<Graded> {
        let (task, hash) = given.task()?;
        if is_quick(task, &log) {
            if self.connections.open() <= FEW_CONNECTIONS {
                return self.grade_here(&given, &log, log_hash, deadline);
            }
            return self.grade_in_turn(given, log, log_hash, deadline).await;
        }
        if let Some(kept) = self.kept(log_hash, hash) {
            return Ok(kept);
        }
        let deadline = Instant::now() + deadline;
        let turn = tokio::time::timeout_at(deadline.into(), Arc::clone(&self.long).acquire_owned()).await;
        let Ok(Ok(turn)) = turn else { return Err(too_late()) };
        let (grader, log_hash) = (Arc::clone(self), log_hash.to_owned());
        let work = tokio::task::spawn_blocking(move || {
            // Held by the work, which goes on where the client leaves.
            let _turn = turn;
            grader.grade_here(&given, &log, &log_hash, deadline.saturating_duration_since(Instant::now()))
        });
        work.await.map_err(|error| ApiError::internal(&error))?
    }

    /// Grades a quick log on the threads that are there for it, behind those that came before.
    async fn grade_in_turn(
        self: &Arc<Self>,
        given: GivenTask,
        log: BlockLog,
        log_hash: &str,
        deadline: Duration,
    ) -> ApiResult<Graded> {
        let deadline = Instant::now() + deadline;
        let (grader, log_hash) = (Arc::clone(self), log_hash.to_owned());
        let (answer, answered) = oneshot::channel();
        self.quick.spawn_fifo(move || {
            // Nobody waits where the client has left.
            if !answer.is_closed() {
                let left = deadline.saturating_duration_since(Instant::now());
                let _ = answer.send(grader.grade_here(&given, &log, &log_hash, left));
            }
        });
        answered.await.map_err(|error| ApiError::internal(&error))?
    }

    /// Grades a log on this thread, however long it takes.
    ///
    /// # Errors
    /// As [`Self::grade`].
    pub fn grade_here(
        &self,
        given: &GivenTask,
        log: &BlockLog,
        log_hash: &str,
        deadline: Duration,
    ) -> ApiResult<Graded> {
        let (task, hash) = given.task()?;
        if let Some(kept) = self.kept(log_hash, hash) {
            return Ok(kept);
        }
        let report = self.compute(task, hash, log, Instant::now() + deadline)?;
        Ok(self.keep(log_hash, hash, report))
    }

    fn compute(&self, task: &Task, hash: &str, log: &BlockLog, deadline: Instant) -> ApiResult<Report> {
        let stop = || self.stop.is_cancelled() || Instant::now() >= deadline;
        let begun = Instant::now();
        let control = Control::until(&stop);
        let graded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| grade_hashed(task, hash, log, &control)));
        match graded {
            Ok(Ok(report)) => {
                metrics::histogram!("plumbline_grade_seconds").record(begun.elapsed().as_secs_f64());
                Ok(report)
            }
            Ok(Err(_stopped)) if self.stop.is_cancelled() => {
                let detail = "The service stops. The request may be sent again.";
                Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "stopping", "Stopping", detail).retry_after(5))
            }
            Ok(Err(_stopped)) => Err(too_late()),
            Err(_panic) => Err(ApiError::internal(&format!("grading {} panicked", task.id))),
        }
    }

    fn kept(&self, log_hash: &str, task_hash: &str) -> Option<Graded> {
        let cache = self.cache.as_ref()?;
        let found = cache.get(&(Box::from(log_hash), Box::from(task_hash)));
        let outcome = if found.is_some() { "hit" } else { "miss" };
        metrics::counter!("plumbline_grade_cache_total", "outcome" => outcome).increment(1);
        found.map(|report| Graded { report, is_cached: true })
    }

    fn keep(&self, log_hash: &str, task_hash: &str, report: Report) -> Graded {
        let report = Arc::new(report);
        if let Some(cache) = &self.cache {
            cache.insert((Box::from(log_hash), Box::from(task_hash)), Arc::clone(&report));
            metrics::gauge!("plumbline_grade_cache_bytes").set(cache.weight() as f64);
        }
        Graded { report, is_cached: false }
    }
}

/// Lets the threads that serve go before this one.
fn yield_to_serving(_index: usize) {
    if let Err(error) = rustix::process::setpriority_process(None, GRADING_NICENESS) {
        tracing::debug!(%error, "grading threads have the same priority as others");
    }
}

fn admitted(places: &Arc<Semaphore>, what: &str) -> ApiResult<OwnedSemaphorePermit> {
    Arc::clone(places).try_acquire_owned().map_err(|_| {
        metrics::counter!("plumbline_grade_refused_total").increment(1);
        ApiError::too_many(format!("many {what} are being graded; come back in a moment"))
    })
}

fn too_late() -> ApiError {
    let detail = "The deadline passed before the log was graded. A longer deadline_ms may help.";
    ApiError::new(StatusCode::GATEWAY_TIMEOUT, "deadline", "Deadline passed", detail).retry_after(1)
}

/// Whether grading takes less than a millisecond or so: few events, no stress simulation, no walk through the space around them.
#[must_use]
pub fn is_quick(task: &Task, log: &BlockLog) -> bool {
    let takes_long = |check: &Check| check.criterion() == Criterion::StructuralStability || check.walks();
    log.event_count() <= QUICK_EVENTS && !task.checks().any(takes_long)
}
