//! Children that wait for a script each, so that nobody waits for one to start.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, Command};
use tokio::sync::Semaphore;

use super::child::{COMMAND, Job};
use super::{ActionLimits, LimitReached, Replayed};

/// Bytes of an answer at most: more than the events that are allowed can take.
const ANSWER_BYTES: u32 = 128 << 20;
/// Why a process was ended that used too much of the processor.
const SIGXCPU: i32 = 24;

/// Runs scripts, a few at a time, each in a process of its own.
#[derive(Debug, Clone)]
pub struct Pool {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    ready: Mutex<Vec<Child>>,
    turns: Semaphore,
    size: usize,
    limits: ActionLimits,
}

impl Pool {
    /// A pool that runs at most `size` scripts at the same time and has as many children waiting.
    #[must_use]
    pub fn new(size: usize, limits: ActionLimits) -> Self {
        let inner = Inner { ready: Mutex::default(), turns: Semaphore::new(size.max(1)), size: size.max(1), limits };
        Self { inner: Arc::new(inner) }
    }

    /// What scripts may use.
    #[must_use]
    pub fn limits(&self) -> &ActionLimits {
        &self.inner.limits
    }

    /// Runs a script to its end or to a limit.
    ///
    /// # Errors
    /// Where no process can be had: a failure of ours.
    pub async fn run(&self, code: &str) -> anyhow::Result<Replayed> {
        let _turn = self.inner.turns.acquire().await?;
        let waiting = self.inner.ready.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut child = match waiting {
            Some(child) => child,
            None => start()?,
        };
        let wall = Duration::from_millis(self.inner.limits.wall_ms);
        let asked = tokio::time::timeout(wall, ask(&mut child, code, &self.inner.limits)).await;
        let done = match asked {
            Ok(Some(replayed)) => Ok(replayed),
            Ok(None) => how_it_ended(child.wait().await?.signal(), &self.inner.limits),
            Err(_late) => {
                let detail = format!("more than {} ms; it was ended from outside", self.inner.limits.wall_ms);
                Ok(stopped("time", detail))
            }
        };
        // It is done, one way or another, and so is its process.
        let _ = child.start_kill();
        let _ = child.wait().await;
        self.refill();
        done
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
        .current_dir("/")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .kill_on_drop(true)
        .spawn()?;
    Ok(child)
}

/// Hands a script over and reads the answer; none where the process ends without one.
async fn ask(child: &mut Child, code: &str, limits: &ActionLimits) -> Option<Replayed> {
    let job = serde_json::to_vec(&Job { code: code.to_owned(), limits: *limits }).ok()?;
    let (input, output) = (child.stdin.as_mut()?, child.stdout.as_mut()?);
    input.write_all(&u32::try_from(job.len()).ok()?.to_le_bytes()).await.ok()?;
    input.write_all(&job).await.ok()?;
    input.flush().await.ok()?;
    let length = output.read_u32_le().await.ok().filter(|length| *length <= ANSWER_BYTES)?;
    let mut answer = vec![0; length as usize];
    output.read_exact(&mut answer).await.ok()?;
    serde_json::from_slice(&answer).ok()
}

fn stopped(limit: &str, detail: String) -> Replayed {
    Replayed { stopped: Some(LimitReached { limit: limit.to_owned(), detail }), ..Replayed::default() }
}

/// What it means that a child ended without an answer: a signal is the script's doing. It had confined itself and run a script
/// before, so an exit of its own is a failure of ours.
fn how_it_ended(signal: Option<i32>, limits: &ActionLimits) -> anyhow::Result<Replayed> {
    match signal {
        Some(SIGXCPU) => Ok(stopped("time", format!("more than {} ms on the processor", limits.cpu_ms))),
        Some(signal) => Ok(stopped("memory", format!("the script brought its process down (signal {signal})"))),
        None => anyhow::bail!("a process for action code ended without an answer"),
    }
}
