//! Pool of replayers, each ready to run a script in a process of its own, so that no script waits for a program to start.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::endless::Endless;
use super::job::{Answer, Job, TurnInput};
use super::replayer::{Outcome, Replayer};
use super::{ActionLimits, LimitReached, Profile, Replayed};
use crate::fair::FairSlots;
use plumbline_engine::text::counted;

/// Processor time for the first attempt at a script, in milliseconds. Most scripts take a few.
const FIRST_MS: u64 = 250;
/// Wall-clock time for the first attempt, in milliseconds: a script may be in a built-in that does not check the time.
const FIRST_WALL_MS: u64 = 1_000;

/// How many times the processor time of a file the files of a job may take together, where each runs on its own.
pub const FILES_TIMES: u64 = 2;

/// The machine gave a script so little processor time that it reached no limit of its own. Later it may.
#[derive(Debug, thiserror::Error)]
#[error("action code did not finish within {wall_ms} ms")]
pub struct Overloaded {
    wall_ms: u64,
}

/// The time that its sender gave a script has passed.
#[derive(Debug, thiserror::Error)]
#[error("action code did not finish in the time that its sender gave it")]
pub struct TooLate;

/// Runs scripts, a few at a time, each in its own process.
#[derive(Debug, Clone)]
pub struct Pool {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    ready: Mutex<Vec<Replayer>>,
    /// Slots for first attempts.
    first: Arc<FairSlots>,
    /// Slots for scripts that took longer than [`FIRST_MS`].
    again: Arc<FairSlots>,
    size: usize,
    limits: ActionLimits,
    endless: Endless,
}

impl Pool {
    /// Creates a pool that runs at most `size` first attempts and `size` second ones at the same time, and keeps `size`
    /// children ready.
    #[must_use]
    pub fn new(size: usize, limits: ActionLimits) -> Self {
        let size = size.max(1);
        let (first, again) = (FairSlots::new(size, size), FairSlots::new(size, size));
        let endless = Endless::new();
        Self { inner: Arc::new(Inner { ready: Mutex::default(), first, again, size, limits, endless }) }
    }

    /// Returns the limits on scripts.
    #[must_use]
    pub fn limits(&self) -> &ActionLimits {
        &self.inner.limits
    }

    /// Runs a script to completion or to a limit, once its sender gets a slot. A script that takes long is killed and
    /// run again in a slot for long scripts, so that short ones need not wait for it. Scripts are deterministic, so the
    /// second attempt does the same.
    ///
    /// The script may take the time `left`, from which the time that it takes is taken; without one, only its own limits
    /// end it. Waiting for a slot does not count.
    ///
    /// # Errors
    /// Returns [`TooLate`] if that time has passed, [`Overloaded`] if the machine has too much to do, and another error if
    /// no process can be started or used, which is a failure of the service.
    pub async fn run(&self, job: &Job, who: &Arc<str>, left: &mut Option<Duration>) -> anyhow::Result<Answer> {
        match job.profile {
            Profile::Mindcraft => self.run_job(job, who, left).await,
            Profile::Published => self.run_files(job, who, left).await,
        }
    }

    /// Runs each file of a job on its own, as files without a common world are run, and puts their results together.
    async fn run_files(&self, job: &Job, who: &Arc<str>, left: &mut Option<Duration>) -> anyhow::Result<Answer> {
        let mut answer = Answer::default();
        let mut events = 0;
        let most_ms = self.inner.limits.cpu_ms * FILES_TIMES;
        for turn in &job.turns {
            let mut replayed: Option<Replayed> = None;
            let files = if let TurnInput::Code(files) = turn { files.as_slice() } else { &[] };
            for (file, number) in files.iter().zip(1..) {
                if answer.cpu_ms >= most_ms {
                    let detail = format!("more than {most_ms} ms of processor time in all files together");
                    let limit = LimitReached { limit: "time".to_owned(), detail };
                    replayed.get_or_insert_default().stopped.get_or_insert(limit);
                    break;
                }
                let one = self.run_job(&Job::of_code(job.profile, file.clone()), who, left).await?;
                answer.cpu_ms += one.cpu_ms;
                let one = one.turns.into_iter().next().unwrap_or_default();
                let one = if files.len() > 1 { one.of_file(number) } else { one };
                events += one.events.len();
                match &mut replayed {
                    None => replayed = Some(one),
                    Some(replayed) => replayed.append(one),
                }
                if events > self.inner.limits.events {
                    let limit = LimitReached::of("events", &self.inner.limits, &counted(events, "event"));
                    replayed.get_or_insert_default().stopped.get_or_insert(limit);
                }
                if replayed.as_ref().is_some_and(|replayed| replayed.stopped.is_some()) {
                    break;
                }
            }
            let replayed = replayed.unwrap_or_default();
            let is_stopped = replayed.stopped.is_some();
            answer.turns.push(replayed);
            if is_stopped {
                break;
            }
        }
        Ok(answer)
    }

    async fn run_job(&self, job: &Job, who: &Arc<str>, left: &mut Option<Duration>) -> anyhow::Result<Answer> {
        let all = self.inner.limits;
        let first = ActionLimits { cpu_ms: FIRST_MS.min(all.cpu_ms), wall_ms: FIRST_WALL_MS.min(all.wall_ms), ..all };
        let slot = self.inner.first.take(who).await;
        let done = self.run_timed(job, &first, left).await?;
        drop(slot);
        match done {
            Some(done) if done.stopped().is_none_or(|stopped| stopped.limit != "time") => return Ok(done),
            _ => {}
        }
        let hash = Endless::hash(job)?;
        if let Some(known) = self.inner.endless.known(&hash, Instant::now()) {
            return Ok(known);
        }
        let _turn = self.inner.again.take(who).await;
        // The same script may have been run meanwhile.
        if let Some(known) = self.inner.endless.known(&hash, Instant::now()) {
            return Ok(known);
        }
        let done = self.run_timed(job, &all, left).await?;
        let done = done.ok_or(Overloaded { wall_ms: all.wall_ms })?;
        self.inner.endless.keep(hash, &done, Instant::now())?;
        Ok(done)
    }

    /// Runs a script in a process for at most the time that is left, and takes from it what the script took; returns
    /// `None` if its wall-clock time ran out before.
    async fn run_timed(
        &self,
        job: &Job,
        limits: &ActionLimits,
        left: &mut Option<Duration>,
    ) -> anyhow::Result<Option<Answer>> {
        let (begun, wall) = (Instant::now(), Duration::from_millis(limits.wall_ms));
        let done = self.run_within(job, limits, left.map_or(wall, |left| wall.min(left))).await?;
        let is_cut = done.is_none() && left.is_some_and(|left| left < wall);
        *left = left.map(|left| left.saturating_sub(begun.elapsed()));
        if is_cut { Err(TooLate.into()) } else { Ok(done) }
    }

    /// Runs a script in a process; returns `None` if the wall-clock time ran out.
    async fn run_within(&self, job: &Job, limits: &ActionLimits, wall: Duration) -> anyhow::Result<Option<Answer>> {
        // Only a script that breaks out of its engine can leave bytes behind. Then another replayer runs this one.
        for _ in 0..2 {
            let mut replayer = self.take()?;
            let Ok(done) = tokio::time::timeout(wall, replayer.run(job, limits)).await else {
                drop(replayer);
                self.refill();
                return Ok(None);
            };
            self.give_back(replayer);
            match done? {
                Outcome::Answer(answer) => return Ok(Some(answer)),
                Outcome::Strayed => tracing::warn!("bytes of another script came instead of an answer"),
            }
        }
        anyhow::bail!("processes for action code answer with what nobody asked for")
    }

    /// Takes a replayer that waits, or starts a new one.
    fn take(&self) -> anyhow::Result<Replayer> {
        let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(mut replayer) = ready.pop() {
            if replayer.is_ready() {
                return Ok(replayer);
            }
        }
        drop(ready);
        Replayer::start()
    }

    /// Keeps a replayer for the next script if it can be used and is needed.
    fn give_back(&self, mut replayer: Replayer) {
        if replayer.is_ready() {
            let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
            if ready.len() < self.inner.size {
                ready.push(replayer);
            }
        } else {
            drop(replayer);
            self.refill();
        }
    }

    /// Starts replayers until one waits for each slot.
    pub fn refill(&self) {
        let ready = || self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while ready().len() < self.inner.size {
            // Without the lock, which every script needs.
            let started = Replayer::start();
            match started {
                Ok(replayer) => {
                    let mut ready = ready();
                    if ready.len() < self.inner.size {
                        ready.push(replayer);
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, "could not start a process for action code");
                    return;
                }
            }
        }
    }
}
