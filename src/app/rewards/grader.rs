//! Grading within a request: bounded admission, fair scheduling, a deadline for each log, and a content-addressed cache
//! of results.
//!
//! Work that takes next to no time is done on the thread that serves the request. The rest goes to one of two lanes,
//! each with its own threads and with fair turns between senders: short work, and long work, which yields to everything
//! else. If the client has left, its work is not begun, or is stopped.

use std::collections::BTreeSet;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use metrics::Histogram;
use quick_cache::sync::Cache;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use super::given_task::GivenTask;
use super::request::Detail;
use super::results::{Outcome, Results, Work};
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::grading::{Cores, Unfinished, execute};
use crate::app::limits::LIMITS;
use crate::app::load::Connections;
use crate::fair::{FairSlots, NoPermit, Permit, PermitPool};
use crate::threads::yield_to_others;
use plumbline_engine::grading::baseline::Baseline;
use plumbline_engine::grading::cost::{Cost, cost};
use plumbline_engine::grading::{grade_hashed, score_log};
use plumbline_engine::tasks::catalogue::Entry;

/// Number of connections up to which logs are graded on the threads that serve their requests. With more connections,
/// logs would wait unseen in the queue of these threads, and other requests behind them.
const FEW_CONNECTIONS: usize = 256;
/// Niceness of the threads that do short work, compared with those that serve.
const SHORT_NICENESS: i32 = 5;
/// Niceness of the threads that do long work, which yield to all others.
const LONG_NICENESS: i32 = 10;
/// Slow logs of batches in memory at the same time; a sender has a quarter of the slots.
const SLOW_SLOTS: usize = 256;
/// Number of baselines in the cache: enough for all tasks of a few suites.
const BASELINES: usize = 4_096;

/// Time that grading took: the series is looked up once, and not for each log.
static GRADE_SECONDS: LazyLock<Histogram> = LazyLock::new(|| metrics::histogram!("plumbline_grade_seconds"));

/// Length of a piece of work, which decides by which threads it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Work that takes up to about half a second.
    Short,
    /// Work that takes longer.
    Long,
}

/// Threads, with fair slots to use them.
#[derive(Debug)]
struct Threads {
    slots: Arc<FairSlots>,
    pool: rayon::ThreadPool,
}

impl Threads {
    fn start(name: &'static str, count: usize, each: usize, niceness: i32) -> anyhow::Result<Self> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).thread_name(move |i| format!("{name}-{i}"));
        let pool = pool.start_handler(move |_| yield_to_others(niceness)).panic_handler(note_panic).build()?;
        Ok(Self { slots: FairSlots::new(count, each), pool })
    }
}

/// Grader of the logs of requests that wait for the result.
#[derive(Debug)]
pub struct Grader {
    waiting: Arc<PermitPool>,
    batches: Arc<PermitPool>,
    /// Slots of logs of batches that have code or take long.
    pub slow_slots: Arc<FairSlots>,
    short: Threads,
    long: Threads,
    connections: Connections,
    results: Option<Results>,
    /// Baselines by the hash of the task.
    baselines: Cache<Box<str>, Arc<Baseline>>,
    stop: CancellationToken,
}

/// Result of grading, with its origin.
#[derive(Debug, Clone)]
pub struct Graded {
    /// Scores, and the report if it was asked for.
    pub outcome: Outcome,
    /// Whether they came from the cache.
    pub is_cached: bool,
}

/// Limits on how long work may take, and how long it may wait to begin.
#[derive(Debug, Clone, Copy)]
pub struct Deadline {
    /// Time for the work.
    pub work: Duration,
    /// Time to wait for the work to begin; if none, `work` covers both.
    pub wait: Option<Duration>,
}

impl Deadline {
    /// Returns what is left for more work on the same request after so much time, if the time covers waiting too.
    #[must_use]
    pub fn after(self, passed: Duration) -> Self {
        if self.wait.is_some() { self } else { Self { work: self.work.saturating_sub(passed), ..self } }
    }
}

impl From<Duration> for Deadline {
    /// Covers both waiting and work.
    fn from(work: Duration) -> Self {
        Self { work, wait: None }
    }
}

/// Condition under which work may go on.
#[derive(Debug, Clone)]
pub struct Until {
    deadline: Instant,
    left: CancellationToken,
}

impl Until {
    /// Creates a deadline from now on that does not depend on a client.
    #[must_use]
    pub fn within(deadline: Duration) -> Self {
        Self { deadline: Instant::now() + deadline, left: CancellationToken::new() }
    }

    /// Returns the same condition, shortened to at most this time from now.
    #[must_use]
    pub fn and_within(&self, deadline: Duration) -> Self {
        Self { deadline: self.deadline.min(Instant::now() + deadline), left: self.left.clone() }
    }

    /// Returns whether the client has left.
    #[must_use]
    pub fn has_left(&self) -> bool {
        self.left.is_cancelled()
    }
}

impl Grader {
    /// Creates a grader with a cache of `cache_bytes`, or without a cache if that is 0.
    ///
    /// # Errors
    /// Returns an error if a thread cannot be started.
    pub fn new(cache_bytes: usize, connections: &Connections, stop: CancellationToken) -> anyhow::Result<Self> {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Ok(Self {
            waiting: PermitPool::new(LIMITS.grades_waiting, LIMITS.grades_waiting_per_sender),
            batches: PermitPool::new(LIMITS.grade_batches, LIMITS.grade_batches_per_sender),
            slow_slots: FairSlots::new(SLOW_SLOTS, SLOW_SLOTS / 4),
            short: Threads::start("grade-short", cores, cores, SHORT_NICENESS)?,
            // A single sender leaves one slot free for others. A large build is split between the threads, so none
            // idles.
            long: Threads::start("grade-long", cores, cores.saturating_sub(1), LONG_NICENESS)?,
            connections: connections.clone(),
            results: (cache_bytes > 0).then(|| Results::within(cache_bytes)),
            baselines: Cache::new(BASELINES),
            stop,
        })
    }

    /// Takes a permit for a log that is graded or waits.
    ///
    /// # Errors
    /// Returns 429 at once if all permits are taken.
    pub fn admit(&self, who: &Arc<str>) -> AppResult<Permit> {
        admitted(&self.waiting, who, "logs")
    }

    /// Takes a permit for a whole batch.
    ///
    /// # Errors
    /// Returns 429 at once if all permits are taken.
    pub fn admit_batch(&self, who: &Arc<str>) -> AppResult<Permit> {
        admitted(&self.batches, who, "batches")
    }

    /// Runs work on the threads for its length when the sender gets a slot. If the caller goes away, the work is not begun,
    /// or is asked to end.
    ///
    /// # Errors
    /// Returns 504 if no slot is free in time, and otherwise the error of the work.
    pub async fn run<T: Send + 'static>(
        &self,
        length: Length,
        who: &Arc<str>,
        deadline: Deadline,
        work: impl FnOnce(&Until) -> AppResult<T> + Send + 'static,
    ) -> AppResult<T> {
        let mut until = Until::within(deadline.work);
        let _guard = until.left.clone().drop_guard();
        let wait = deadline.wait.map_or(until.deadline, |wait| Instant::now() + wait);
        let threads = match length {
            Length::Short => &self.short,
            Length::Long => &self.long,
        };
        let slot = tokio::time::timeout_at(wait.into(), threads.slots.take(who)).await;
        let Ok(slot) = slot else { return Err(too_late()) };
        if deadline.wait.is_some() {
            until.deadline = Instant::now() + deadline.work;
        }
        let (answer, answered) = oneshot::channel();
        threads.pool.spawn_fifo(move || {
            let _slot = slot;
            if !until.has_left() {
                // The receiver may be gone.
                let _ = answer.send(work(&until));
            }
        });
        answered.await.map_err(|error| AppError::internal(&error))?
    }

    /// Ensures that the baseline of a task is known; computes it on the threads for long work if necessary.
    ///
    /// # Errors
    /// Returns 504 if the deadline passes, and 503 if the service stops.
    pub async fn know_baseline(
        self: &Arc<Self>,
        given: &GivenTask,
        deadline: Deadline,
        who: &Arc<str>,
    ) -> AppResult<()> {
        if self.knows_baseline(given) {
            return Ok(());
        }
        let (grader, given) = (Arc::clone(self), given.clone());
        self.run(Length::Long, who, deadline, move |until| grader.baseline(&given, until).map(|_| ())).await
    }

    /// Returns the numbers of the tasks among these that a log can earn more for than one that does nothing, which the
    /// scheme `shaped` needs.
    ///
    /// # Errors
    /// Returns 504 if a deadline passes, and 503 if the service stops.
    pub async fn beatable(
        self: &Arc<Self>,
        entry: &Arc<Entry>,
        numbers: impl Iterator<Item = u32>,
        who: &Arc<str>,
    ) -> AppResult<BTreeSet<u32>> {
        let work = Duration::from_millis(LIMITS.grade_default_deadline_ms);
        // Each waits for its turn as the items of a batch do.
        let deadline = Deadline { work, wait: Some(Duration::from_secs(LIMITS.grade_batch_wait_seconds)) };
        let mut beatable = BTreeSet::new();
        for number in numbers {
            let given = GivenTask::Listed(Arc::clone(entry), number);
            self.know_baseline(&given, deadline, who).await?;
            if self.baseline(&given, &Until::within(work))?.can_be_beaten() {
                beatable.insert(number);
            }
        }
        Ok(beatable)
    }

    /// Returns whether the baseline of a task is known.
    #[must_use]
    pub fn knows_baseline(&self, given: &GivenTask) -> bool {
        given.task().is_ok_and(|(_, hash)| self.baselines.contains_key(hash))
    }

    /// Returns the baseline of a task: what a log that does nothing earns. Computes it unless it is known.
    ///
    /// # Errors
    /// Returns 504 if the deadline passes, and 503 if the service stops.
    pub fn baseline(&self, given: &GivenTask, until: &Until) -> AppResult<Arc<Baseline>> {
        let (task, hash) = given.task()?;
        if let Some(known) = self.baselines.get(hash) {
            return Ok(known);
        }
        let stop = || self.is_over(until);
        let baseline = execute(Cores::One, &stop, |control| Baseline::of(task, control));
        let baseline = baseline.map_err(|why| self.unfinished(why, &task.id))?;
        let baseline = Arc::new(baseline);
        self.baselines.insert(Box::from(hash), Arc::clone(&baseline));
        Ok(baseline)
    }

    /// Grades a log: on this thread if that is quick, or else on the threads for its length when the sender gets a slot.
    ///
    /// # Errors
    /// Returns 504 if the deadline passes, 503 if the service stops, and 500 if grading fails; never a score.
    pub async fn grade(self: &Arc<Self>, work: &Arc<Work>, deadline: Deadline, who: &Arc<str>) -> AppResult<Graded> {
        let (task, hash) = work.task()?;
        let (length, cores) = match cost(task, &work.log) {
            Cost::Immediate if self.connections.open() <= FEW_CONNECTIONS => {
                return self.grade_on(Cores::One, work, &Until::within(deadline.work));
            }
            Cost::Immediate | Cost::Short => (Length::Short, Cores::One),
            // The threads for long work that are idle share the work.
            Cost::Long => (Length::Long, Cores::Idle),
        };
        if let Some(kept) = self.kept(work, hash) {
            return Ok(kept);
        }
        let (grader, work) = (Arc::clone(self), Arc::clone(work));
        self.run(length, who, deadline, move |until| grader.grade_on(cores, &work, until)).await
    }

    /// Grades a log on this thread, however long it takes.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::grade`].
    pub fn grade_here(&self, work: &Work, until: &Until) -> AppResult<Graded> {
        self.grade_on(Cores::One, work, until)
    }

    fn grade_on(&self, cores: Cores, work: &Work, until: &Until) -> AppResult<Graded> {
        let (_, hash) = work.task()?;
        if let Some(kept) = self.kept(work, hash) {
            return Ok(kept);
        }
        let outcome = self.compute(cores, work, until)?;
        if let Some(results) = &self.results {
            results.keep(work, hash, &outcome);
        }
        Ok(Graded { outcome, is_cached: false })
    }

    fn kept(&self, work: &Work, hash: &str) -> Option<Graded> {
        let outcome = self.results.as_ref()?.get(work, hash)?;
        Some(Graded { outcome, is_cached: true })
    }

    fn is_over(&self, until: &Until) -> bool {
        self.stop.is_cancelled() || until.has_left() || Instant::now() >= until.deadline
    }

    fn unfinished(&self, why: Unfinished, task: &str) -> AppError {
        match why {
            Unfinished::Stopped => self.stopped(),
            Unfinished::Panicked => AppError::internal(&format!("grading {task} panicked")),
        }
    }

    fn stopped(&self) -> AppError {
        if !self.stop.is_cancelled() {
            return too_late();
        }
        let detail = "The service is shutting down. The request may be sent again.";
        AppError::new(Kind::Stopping, detail).retry_after(5)
    }

    fn compute(&self, cores: Cores, work: &Work, until: &Until) -> AppResult<Outcome> {
        let (task, hash) = work.task()?;
        let stop = || self.is_over(until);
        let begun = Instant::now();
        let outcome = execute(cores, &stop, |control| match work.detail {
            Detail::Scores => score_log(task, &work.log, control).map(Outcome::from),
            Detail::Report => grade_hashed(task, hash, &work.log, control).map(Outcome::from),
        });
        let outcome = outcome.map_err(|why| self.unfinished(why, &task.id))?;
        GRADE_SECONDS.record(begun.elapsed().as_secs_f64());
        Ok(outcome)
    }
}

/// Logs a panic of such work; the caller gets the error that the service failed.
pub fn note_panic(_panic: Box<dyn std::any::Any + Send>) {
    tracing::error!("work for a request panicked");
}

fn admitted(permits: &Arc<PermitPool>, who: &Arc<str>, what: &str) -> AppResult<Permit> {
    permits.take(who).map_err(|none| {
        metrics::counter!("plumbline_grade_refused_total").increment(1);
        AppError::too_many(match none {
            NoPermit::All => format!("many {what} are being graded; send the request again in a moment"),
            NoPermit::Own => format!("many {what} of yours are being graded; send the request again in a moment"),
        })
    })
}

fn too_late() -> AppError {
    let detail = "The deadline passed before the log was graded. A longer deadline_ms may help.";
    AppError::new(Kind::Deadline, detail).retry_after(1)
}
