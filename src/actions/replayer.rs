//! A process that makes another for each script: made once, it starts a script in a fraction of the time that a program
//! takes to start.

use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, ChildStdout, Command};

use super::child::{COMMAND, TAG_BYTES, WANTED};
use super::job::{Answer, Job, Order, WorldState};
use super::{ActionLimits, CRASHED, LimitReached, Replayed};

/// Maximum size of an answer in bytes, which is more than the allowed events can take.
const ANSWER_BYTES: u32 = 128 << 20;
/// Size of an answer in bytes from which reading it is left to another thread.
const LONG_ANSWER_BYTES: usize = 64 << 10;
/// Number of scripts after which a replayer is replaced: scripts of one replayer have the same layout of memory.
const MAX_SCRIPTS: u32 = 500;
/// Time for what a process that has ended left in the pipe.
const LEFT_IN_PIPE: Duration = Duration::from_secs(1);

/// A running replayer. Dropping it ends it, and the script that it runs with it.
#[derive(Debug)]
pub struct Replayer {
    process: Child,
    scripts: u32,
    /// Whether the last script ended as it should, so that nothing of it is left in the pipes.
    is_clean: bool,
}

/// What came of a script.
#[derive(Debug)]
pub enum Outcome {
    /// The answer, also one that says how the process ended.
    Answer(Answer),
    /// Bytes of another script came instead of an answer. The script may be run again by another replayer.
    Strayed,
}

impl Replayer {
    /// Starts a replayer: this program, which gets nothing from this process but three pipes.
    ///
    /// # Errors
    /// Returns an error if the process cannot be started.
    pub fn start() -> anyhow::Result<Self> {
        let process = Command::new(own_program()?)
            .arg(COMMAND)
            .env_clear()
            // Makes local time the same on every machine.
            .env("TZ", "UTC0")
            .current_dir("/")
            // Signals to the service's process group, such as Ctrl-C, are not meant for the child.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            .spawn()?;
        Ok(Self { process, scripts: 0, is_clean: true })
    }

    /// Returns whether it can run another script.
    pub fn is_ready(&mut self) -> bool {
        // It may have been killed from outside while it waited.
        self.is_clean && self.scripts < MAX_SCRIPTS && matches!(self.process.try_wait(), Ok(None))
    }

    /// Runs a script to its end. If this future is dropped before, the replayer cannot be used any more.
    ///
    /// # Errors
    /// Returns an error if the script cannot be sent, or the answer is too long or invalid.
    pub async fn run(&mut self, job: &Job, limits: &ActionLimits) -> anyhow::Result<Outcome> {
        self.is_clean = false;
        self.scripts += 1;
        let tag = *uuid::Uuid::new_v4().as_bytes();
        let job = serde_json::to_vec(&Order { job: job.clone(), limits: *limits })?;
        let mut order = Vec::with_capacity(1 + TAG_BYTES + 4 + job.len());
        order.push(WANTED);
        order.extend(tag);
        order.extend(u32::try_from(job.len())?.to_le_bytes());
        order.extend(job);
        let (Some(input), Some(output), Some(status)) =
            (self.process.stdin.as_mut(), self.process.stdout.as_mut(), self.process.stderr.as_mut())
        else {
            anyhow::bail!("a process for action code has no pipes");
        };
        input.write_all(&order).await?;
        input.flush().await?;
        let (answer, ended) = {
            let mut answer = std::pin::pin!(read_answer(output, tag));
            let mut ended = std::pin::pin!(status.read_i32_le());
            tokio::select! {
                answer = &mut answer => match answer? {
                    // What wrote it may be waiting for somebody to read the rest.
                    Some(Told::Stray) => return Ok(Outcome::Strayed),
                    answer => (answer, ended.await),
                },
                ended = &mut ended => match &ended {
                    // Whatever the script wrote is in the pipe now. If it ended well, that is an answer, unless the
                    // script broke out of its engine.
                    Ok(0) => (tokio::time::timeout(LEFT_IN_PIPE, answer).await??, ended),
                    Ok(_) => (None, ended),
                    // The replayer could not make another process, and runs the script itself.
                    Err(_) => (answer.await?, ended),
                },
            }
        };
        let status = match ended {
            Ok(status) => ExitStatus::from_raw(status),
            Err(_) => self.process.wait().await?,
        };
        let is_forked = ended.is_ok();
        match answer {
            Some(Told::Answer(bytes)) => {
                let left = self.process.stdout.as_ref().map(rustix::io::ioctl_fionread);
                self.is_clean = is_forked && status.success() && matches!(left, Some(Ok(0)));
                Ok(Outcome::Answer(understood(bytes).await?))
            }
            Some(Told::Stray) => Ok(Outcome::Strayed),
            None => Ok(Outcome::Answer(how_it_ended(status.signal(), limits)?)),
        }
    }
}

/// What came through the pipe of answers.
enum Told {
    Answer(Vec<u8>),
    Stray,
}

/// Reads an answer; none if the process ended without one.
async fn read_answer(output: &mut ChildStdout, tag: [u8; TAG_BYTES]) -> anyhow::Result<Option<Told>> {
    let mut found = [0; TAG_BYTES];
    if output.read_exact(&mut found).await.is_err() {
        return Ok(None);
    }
    if found != tag {
        return Ok(Some(Told::Stray));
    }
    let Ok(length) = output.read_u32_le().await else { return Ok(None) };
    anyhow::ensure!(length <= ANSWER_BYTES, "the answer is too long: {length} bytes");
    let mut answer = vec![0; length as usize];
    Ok(output.read_exact(&mut answer).await.is_ok().then_some(Told::Answer(answer)))
}

async fn understood(bytes: Vec<u8>) -> anyhow::Result<Answer> {
    let answer: Answer = if bytes.len() < LONG_ANSWER_BYTES {
        serde_json::from_slice(&bytes)?
    } else {
        tokio::task::spawn_blocking(move || serde_json::from_slice(&bytes)).await??
    };
    let is_sound = answer.turns.iter().all(Replayed::is_sound) && answer.end.as_ref().is_none_or(WorldState::is_sound);
    anyhow::ensure!(is_sound, "the answer contains invalid events or an invalid world");
    Ok(answer)
}

/// Returns this program, also if its file was replaced by that of another version since it started.
fn own_program() -> std::io::Result<PathBuf> {
    let running = Path::new("/proc/self/exe");
    if running.exists() { Ok(running.to_owned()) } else { std::env::current_exe() }
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

/// Interprets the end of a process without an answer. It had confined itself, so these
/// signals are caused by the script; others, and a regular exit, come from outside and are a failure of the service.
fn how_it_ended(signal: Option<i32>, limits: &ActionLimits) -> anyhow::Result<Answer> {
    let stopped = |limit: &str, detail: String| {
        let stopped = Some(LimitReached { limit: limit.to_owned(), detail });
        Answer { turns: vec![Replayed { stopped, ..Replayed::default() }], ..Answer::default() }
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
