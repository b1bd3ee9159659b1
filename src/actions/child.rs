//! The process that makes another for each script, and the one that runs a script: it confines itself, reads the script,
//! runs it, writes the answer, and exits.
//!
//! The first never reads a script, so none can find what another sender wrote.

use std::io::{Read as _, Write as _};
use std::os::unix::process::ExitStatusExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use rustix::process::{Signal, set_parent_process_death_signal};

use super::compared::tell_difference;
use super::confine::confine;
use super::job::{Answer, Job, Order, TurnInput};
use super::memory::PeakMemory;
use super::mindcraft::Prepared;
use super::sandbox::cpu_ms;
use super::{ActionLimits, Profile, mindcraft, published};
use plumbline_engine::intake::code::{left_out_of, without_fences};

/// Name of the command that runs as this process.
pub const COMMAND: &str = "run-action-code";
/// Byte that asks for a process for a script. What follows it is read by that process.
pub const WANTED: u8 = b'r';
/// Number of bytes that begin an order, and the answer to it: an answer that begins with other bytes is ignored.
pub const TAG_BYTES: usize = 16;

/// Runs scripts, each in a process of its own, until standard input ends. Each is asked for by [`WANTED`], followed by a
/// tag, the length of an `Order` in bytes as a little-endian `u32`, and the order as JSON. Tag, length and answer are
/// written to standard output, and the status of the process that has ended to standard error, as a little-endian `i32`.
///
/// Where this process may not make another, it runs one script itself, and ends.
///
/// # Errors
/// Returns an error if the process cannot be confined, or its input is not a job.
pub fn run(limits: &ActionLimits) -> anyhow::Result<ExitCode> {
    // Runs scripts before any process is confined: libraries initialise on first use, with system calls that
    // confinement forbids. State built here, such as the table of blocks, need not be rebuilt for each script.
    let prepared = || Prepared::new(limits).map_err(|error| anyhow::anyhow!(error.message));
    published::run("skills.wait(bot, 1); new Date(0).getHours()", limits, &PeakMemory::unknown());
    let first = Job::of_code(Profile::Mindcraft, "await skills.placeBlock(bot, 'stone', 0, 0, 0);".to_owned());
    mindcraft::run(&first, limits, &PeakMemory::unknown(), prepared()?);
    let prepared = prepared()?;
    while is_wanted()? {
        match safe_fork::fork() {
            Ok(Some(script)) => {
                let status = script.join()?.into_raw();
                std::io::stderr().write_all(&status.to_le_bytes())?;
            }
            Ok(None) => {
                set_parent_process_death_signal(Some(Signal::KILL))?;
                return run_script(limits, prepared);
            }
            Err(_) => return run_script(limits, prepared),
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Waits until a script is there. Returns false if the pool no longer needs this process.
fn is_wanted() -> anyhow::Result<bool> {
    let mut byte = [0];
    loop {
        // Without a buffer: what follows is for another process.
        match rustix::io::read(std::io::stdin(), &mut byte) {
            Ok(0) => return Ok(false),
            Ok(_) => {
                anyhow::ensure!(byte[0] == WANTED, "expected a request for a script");
                return Ok(true);
            }
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

fn run_script(limits: &ActionLimits, prepared: Prepared) -> anyhow::Result<ExitCode> {
    // The parent process reports how a script ended. Messages that libraries print must not reach its pipe.
    rustix::stdio::dup2_stderr(std::fs::OpenOptions::new().write(true).open("/dev/null")?)?;
    let peak = PeakMemory::of_this_process();
    confine(limits)?;
    let (mut tag, mut length) = ([0; TAG_BYTES], [0; 4]);
    let mut input = std::io::stdin().lock();
    input.read_exact(&mut tag)?;
    input.read_exact(&mut length)?;
    let mut job = vec![0; u32::from_le_bytes(length) as usize];
    input.read_exact(&mut job)?;
    let order: Order = serde_json::from_slice(&job)?;
    // A script may modify the objects that it is given and so break an assumption of ours; the fault is the script's.
    let replayed = catch_unwind(AssertUnwindSafe(|| replay(&order.job, &order.limits, &peak, prepared)));
    let mut answer = replayed.unwrap_or_else(|_| Answer::crashed());
    answer.cpu_ms = cpu_ms();
    let answer = serde_json::to_vec(&answer)?;
    let mut output = std::io::stdout().lock();
    output.write_all(&tag)?;
    output.write_all(&u32::try_from(answer.len())?.to_le_bytes())?;
    output.write_all(&answer)?;
    output.flush()?;
    Ok(ExitCode::SUCCESS)
}

fn replay(job: &Job, limits: &ActionLimits, peak: &PeakMemory, prepared: Prepared) -> Answer {
    match job.profile {
        Profile::Mindcraft => {
            let mut answer = mindcraft::run(job, limits, peak, prepared);
            if job.is_compared {
                tell_difference(job, limits, &mut answer);
            }
            answer
        }
        Profile::Published => {
            let files = job.turns.iter().map(|turn| match turn {
                TurnInput::Code(files) => match files.as_slice() {
                    [file] => {
                        let mut replayed = published::run(&without_fences(file), limits, peak);
                        if replayed.events.is_empty() || replayed.error.is_some() {
                            replayed.notes.extend(left_out_of(file));
                        }
                        replayed
                    }
                    _ => super::Replayed::default(),
                },
                TurnInput::Events(_) => super::Replayed::default(),
            });
            Answer { turns: files.collect(), ..Answer::default() }
        }
    }
}
