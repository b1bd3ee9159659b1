//! Pool of child processes, each ready to run one script, so that no script waits for a process to start.

use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, Command};

use super::child::COMMAND;
use super::job::{Answer, Job, Order, TurnInput, WorldState};
use super::{ActionLimits, CRASHED, LimitReached, Profile, Replayed};
use crate::fair::FairSlots;
use plumbline_engine::text::counted;

/// Processor time for the first attempt at a script, in milliseconds. Most scripts take a few.
const FIRST_MS: u64 = 250;
/// Wall-clock time for the first attempt, in milliseconds: a script may be in a built-in that does not check the time.
const FIRST_WALL_MS: u64 = 1_000;
/// Maximum size of an answer in bytes, which is more than the allowed events can take.
const ANSWER_BYTES: u32 = 128 << 20;

/// Runs scripts, a few at a time, each in its own process.
#[derive(Debug, Clone)]
pub struct Pool {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    ready: Mutex<Vec<Child>>,
    /// Slots for first attempts.
    first: Arc<FairSlots>,
    /// Slots for scripts that took longer than [`FIRST_MS`].
    again: Arc<FairSlots>,
    size: usize,
    limits: ActionLimits,
}

impl Pool {
    /// Creates a pool that runs at most `size` first attempts and `size` second ones at the same time, and keeps `size`
    /// children ready.
    #[must_use]
    pub fn new(size: usize, limits: ActionLimits) -> Self {
        let size = size.max(1);
        let (first, again) = (FairSlots::new(size, size), FairSlots::new(size, size));
        Self { inner: Arc::new(Inner { ready: Mutex::default(), first, again, size, limits }) }
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
    /// # Errors
    /// Returns an error if no process can be started or used, which is a failure of the service.
    pub async fn run(&self, job: &Job, who: &Arc<str>) -> anyhow::Result<Answer> {
        match job.profile {
            Profile::Mindcraft => self.run_job(job, who).await,
            Profile::Published => self.run_files(job, who).await,
        }
    }

    /// Runs each file of a job on its own, as files without a common world are run, and puts their results together.
    async fn run_files(&self, job: &Job, who: &Arc<str>) -> anyhow::Result<Answer> {
        let mut answer = Answer::default();
        let mut events = 0;
        for turn in &job.turns {
            let mut replayed: Option<Replayed> = None;
            let files = if let TurnInput::Code(files) = turn { files.as_slice() } else { &[] };
            for (file, number) in files.iter().zip(1..) {
                let one = self.run_job(&Job::of_code(job.profile, file.clone()), who).await?;
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

    async fn run_job(&self, job: &Job, who: &Arc<str>) -> anyhow::Result<Answer> {
        let all = self.inner.limits;
        let first = ActionLimits { cpu_ms: FIRST_MS.min(all.cpu_ms), wall_ms: FIRST_WALL_MS.min(all.wall_ms), ..all };
        let turn = self.inner.first.take(who).await;
        let done = self.run_within(job, &first).await?;
        drop(turn);
        match done {
            Some(done) if done.stopped().is_none_or(|stopped| stopped.limit != "time") => return Ok(done),
            _ => {}
        }
        let _turn = self.inner.again.take(who).await;
        let done = self.run_within(job, &all).await?;
        // No script may use that much processor time, so the machine is overloaded.
        done.ok_or_else(|| anyhow::anyhow!("action code did not finish within {} ms", all.wall_ms))
    }

    /// Runs a script in a child; returns `None` if its wall-clock time ran out.
    async fn run_within(&self, job: &Job, limits: &ActionLimits) -> anyhow::Result<Option<Answer>> {
        let mut child = self.take()?;
        let wall = Duration::from_millis(limits.wall_ms);
        let asked = tokio::time::timeout(wall, async {
            match ask(&mut child, job, limits).await? {
                Some(answer) => Ok(answer),
                None => how_it_ended(child.wait().await?.signal(), limits),
            }
        });
        let done = asked.await;
        // Each process runs one script, and this one is done, one way or another.
        child.kill().await?;
        self.refill();
        done.ok().transpose()
    }

    /// Takes a ready child, or starts a new one.
    fn take(&self) -> anyhow::Result<Child> {
        let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(mut child) = ready.pop() {
            // A child may have been killed from outside while it waited.
            if matches!(child.try_wait(), Ok(None)) {
                return Ok(child);
            }
        }
        start()
    }

    /// Starts children until `size` of them are ready.
    pub fn refill(&self) {
        let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while ready.len() < self.inner.size {
            match start() {
                Ok(child) => ready.push(child),
                Err(error) => {
                    tracing::warn!(%error, "could not start a process for action code");
                    return;
                }
            }
        }
    }
}

/// Returns this program, also if its file was replaced by that of another version since it started.
fn own_program() -> std::io::Result<PathBuf> {
    let running = Path::new("/proc/self/exe");
    if running.exists() { Ok(running.to_owned()) } else { std::env::current_exe() }
}

/// Starts a child: this program, which gets nothing from this process but two pipes.
fn start() -> anyhow::Result<Child> {
    let child = Command::new(own_program()?)
        .arg(COMMAND)
        .env_clear()
        // Makes local time the same on every machine.
        .env("TZ", "UTC0")
        .current_dir("/")
        // Signals to the service's process group, such as Ctrl-C, are not meant for the child.
        .process_group(0)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .kill_on_drop(true)
        .spawn()?;
    Ok(child)
}

/// Sends a script to a child and reads the answer; returns `None` if the process ends without one.
///
/// # Errors
/// Returns an error if the script cannot be sent, or the answer is too long or invalid.
async fn ask(child: &mut Child, job: &Job, limits: &ActionLimits) -> anyhow::Result<Option<Answer>> {
    let job = serde_json::to_vec(&Order { job: job.clone(), limits: *limits })?;
    let (Some(input), Some(output)) = (child.stdin.as_mut(), child.stdout.as_mut()) else {
        anyhow::bail!("a process for action code has no pipes");
    };
    input.write_all(&u32::try_from(job.len())?.to_le_bytes()).await?;
    input.write_all(&job).await?;
    input.flush().await?;
    let Ok(length) = output.read_u32_le().await else { return Ok(None) };
    anyhow::ensure!(length <= ANSWER_BYTES, "the answer is too long: {length} bytes");
    let mut answer = vec![0; length as usize];
    if output.read_exact(&mut answer).await.is_err() {
        return Ok(None);
    }
    let answer = tokio::task::spawn_blocking(move || serde_json::from_slice::<Answer>(&answer)).await??;
    let is_sound = answer.turns.iter().all(Replayed::is_sound) && answer.end.as_ref().is_none_or(WorldState::is_sound);
    anyhow::ensure!(is_sound, "the answer contains invalid events or an invalid world");
    Ok(Some(answer))
}

/// Signals with which the system ends a process for what it did, by name.
const CRASHES: [(i32, &str); 6] = [
    (libc::SIGABRT, "SIGABRT"),
    (libc::SIGSEGV, "SIGSEGV"),
    (libc::SIGBUS, "SIGBUS"),
    (libc::SIGSYS, "SIGSYS"),
    (libc::SIGILL, "SIGILL"),
    (libc::SIGFPE, "SIGFPE"),
];

/// Interprets the end of a child without an answer. The child had confined itself and run a script before, so these
/// signals are caused by the script; others, and a regular exit, come from outside and are a failure of the service.
fn how_it_ended(signal: Option<i32>, limits: &ActionLimits) -> anyhow::Result<Answer> {
    let stopped = |limit: &str, detail: String| {
        let stopped = Some(LimitReached { limit: limit.to_owned(), detail });
        Answer { turns: vec![Replayed { stopped, ..Replayed::default() }], end: None }
    };
    if signal == Some(libc::SIGXCPU) {
        return Ok(stopped("time", format!("more than {} ms of processor time", limits.cpu_ms)));
    }
    match CRASHES.iter().find(|(crash, _)| signal == Some(*crash)) {
        Some((_, name)) => Ok(stopped(
            CRASHED,
            format!("the script's process ended ({name}); very deep recursion or very much memory can cause this"),
        )),
        None => anyhow::bail!("a process for action code ended without an answer (signal {signal:?})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actions::ACTION_LIMITS;

    #[test]
    fn a_crash_is_not_told_as_a_limit_on_memory() {
        let told =
            |signal| how_it_ended(Some(signal), &ACTION_LIMITS).map(|ended| ended.stopped().unwrap().to_string());
        assert!(told(libc::SIGSEGV).unwrap().starts_with("stopped: the script's process ended (SIGSEGV)"));
        assert!(told(libc::SIGXCPU).unwrap().starts_with("stopped at a limit (time): more than 2000 ms"));
        assert!(told(libc::SIGKILL).is_err());
    }
}
