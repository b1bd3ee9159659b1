//! Children that wait for a script each, so that nobody waits for one to start.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, Command};

use super::child::{COMMAND, Job};
use super::{ActionLimits, LimitReached, Replayed};
use crate::fair::FairSlots;

/// Milliseconds on the processor that a script may take at first. Most take a few.
const FIRST_MS: u64 = 250;
/// Milliseconds after which it is ended at first, whatever it does: it may be in a built-in that does not look at the time.
const FIRST_WALL_MS: u64 = 1_000;
/// Bytes of an answer at most: more than the events that are allowed can take.
const ANSWER_BYTES: u32 = 128 << 20;

/// Runs scripts, a few at a time, each in a process of its own.
#[derive(Debug, Clone)]
pub struct Pool {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    ready: Mutex<Vec<Child>>,
    /// Turns for scripts that were not begun.
    first: Arc<FairSlots>,
    /// Turns for scripts that took longer than [`FIRST_MS`].
    again: Arc<FairSlots>,
    size: usize,
    limits: ActionLimits,
}

impl Pool {
    /// A pool that runs at most `size` scripts at the same time and has as many children waiting.
    #[must_use]
    pub fn new(size: usize, limits: ActionLimits) -> Self {
        let size = size.max(1);
        let (first, again) = (FairSlots::new(size, size), FairSlots::new(size, size));
        Self { inner: Arc::new(Inner { ready: Mutex::default(), first, again, size, limits }) }
    }

    /// What scripts may use.
    #[must_use]
    pub fn limits(&self) -> &ActionLimits {
        &self.inner.limits
    }

    /// Runs a script to its end or to a limit, when its sender's turn comes. A script that takes long is ended and begun again where
    /// only such scripts wait: what it does depends on nothing else, so it does the same, and short ones need not wait for it.
    ///
    /// # Errors
    /// Where no process can be had: a failure of ours.
    pub async fn run(&self, code: &str, who: &Arc<str>) -> anyhow::Result<Replayed> {
        let all = self.inner.limits;
        let first = ActionLimits { cpu_ms: FIRST_MS.min(all.cpu_ms), wall_ms: FIRST_WALL_MS.min(all.wall_ms), ..all };
        let turn = self.inner.first.take(who).await;
        let done = self.run_within(code, &first).await?;
        drop(turn);
        match done {
            Some(done) if done.stopped.as_ref().is_none_or(|stopped| stopped.limit != "time") => return Ok(done),
            _ => {}
        }
        let _turn = self.inner.again.take(who).await;
        let done = self.run_within(code, &all).await?;
        // No script may take so much of the processor: the machine had no time for it.
        done.ok_or_else(|| anyhow::anyhow!("action code was not done after {} ms", all.wall_ms))
    }

    /// Runs a script in a child; none where its time is over, whatever it did with it.
    async fn run_within(&self, code: &str, limits: &ActionLimits) -> anyhow::Result<Option<Replayed>> {
        let mut child = self.take()?;
        let wall = Duration::from_millis(limits.wall_ms);
        let asked = tokio::time::timeout(wall, async {
            match ask(&mut child, code, limits).await? {
                Some(replayed) => Ok(replayed),
                None => how_it_ended(child.wait().await?.signal(), limits),
            }
        });
        let done = asked.await;
        // It is done, one way or another, and so is its process.
        child.kill().await?;
        self.refill();
        done.ok().transpose()
    }

    /// A child that waits, or a new one.
    fn take(&self) -> anyhow::Result<Child> {
        let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(mut child) = ready.pop() {
            // One may have been ended from outside while it waited.
            if matches!(child.try_wait(), Ok(None)) {
                return Ok(child);
            }
        }
        start()
    }

    /// Has as many children wait as may run.
    pub fn refill(&self) {
        let mut ready = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner);
        while ready.len() < self.inner.size {
            match start() {
                Ok(child) => ready.push(child),
                Err(error) => {
                    tracing::warn!(%error, "a process for action code could not be started");
                    return;
                }
            }
        }
    }
}

/// Starts a child: this program, with nothing of this process but two pipes.
fn start() -> anyhow::Result<Child> {
    let child = Command::new(std::env::current_exe()?)
        .arg(COMMAND)
        .env_clear()
        // Local time is the same on every machine.
        .env("TZ", "UTC0")
        .current_dir("/")
        // What is sent to the service's group, such as Ctrl-C, is not meant for it.
        .process_group(0)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .kill_on_drop(true)
        .spawn()?;
    Ok(child)
}

/// Hands a script over and reads the answer; none where the process ends without one.
///
/// # Errors
/// Where it cannot be handed over, or the answer does not read back.
async fn ask(child: &mut Child, code: &str, limits: &ActionLimits) -> anyhow::Result<Option<Replayed>> {
    let job = serde_json::to_vec(&Job { code: code.to_owned(), limits: *limits })?;
    let (Some(input), Some(output)) = (child.stdin.as_mut(), child.stdout.as_mut()) else {
        anyhow::bail!("a process for action code has no pipes");
    };
    input.write_all(&u32::try_from(job.len())?.to_le_bytes()).await?;
    input.write_all(&job).await?;
    input.flush().await?;
    let Ok(length) = output.read_u32_le().await else { return Ok(None) };
    anyhow::ensure!(length <= ANSWER_BYTES, "an answer of {length} bytes");
    let mut answer = vec![0; length as usize];
    if output.read_exact(&mut answer).await.is_err() {
        return Ok(None);
    }
    let replayed = tokio::task::spawn_blocking(move || serde_json::from_slice::<Replayed>(&answer)).await??;
    anyhow::ensure!(replayed.is_sound(), "an answer that cannot be");
    Ok(Some(replayed))
}

/// What it means that a child ended without an answer. It had confined itself and run a script before, so these signals are the
/// script's doing; others, and an exit of its own, come from outside and are a failure of ours.
fn how_it_ended(signal: Option<i32>, limits: &ActionLimits) -> anyhow::Result<Replayed> {
    let stopped = |limit: &str, detail: String| Replayed {
        stopped: Some(LimitReached { limit: limit.to_owned(), detail }),
        ..Replayed::default()
    };
    match signal {
        Some(libc::SIGXCPU) => Ok(stopped("time", format!("more than {} ms on the processor", limits.cpu_ms))),
        Some(signal @ (libc::SIGABRT | libc::SIGSEGV | libc::SIGBUS | libc::SIGSYS | libc::SIGILL | libc::SIGFPE)) => {
            Ok(stopped("memory", format!("the script brought its process down (signal {signal})")))
        }
        other => anyhow::bail!("a process for action code ended without an answer (signal {other:?})"),
    }
}
