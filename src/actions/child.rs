//! The process that runs one script: it confines itself, reads the script, runs it, writes the answer, and exits.

use std::io::{Read as _, Write as _};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use super::confine::confine;
use super::job::{Answer, Job, Order, TurnInput};
use super::memory::PeakMemory;
use super::mindcraft::Prepared;
use super::{ActionLimits, Profile, mindcraft, published};
use plumbline_engine::intake::code::without_fences;

/// Name of the command that runs as this process.
pub const COMMAND: &str = "run-action-code";

/// Replays one job, read from standard input: the length of an `Order` in bytes as a little-endian `u32`, then the
/// order as JSON. The answer is written in the same form.
///
/// # Errors
/// Returns an error if the process cannot be confined, or its input is not a job.
pub fn run(limits: &ActionLimits) -> anyhow::Result<ExitCode> {
    // Runs a script before confinement: libraries set themselves up at first use, with system calls that are then
    // forbidden.
    published::run("skills.wait(bot, 1); new Date(0).getHours()", limits, &PeakMemory::unknown());
    let prepared = Prepared::new(limits).map_err(|error| anyhow::anyhow!(error.message))?;
    let peak = PeakMemory::of_this_process();
    confine(limits)?;
    let mut length = [0; 4];
    let mut input = std::io::stdin().lock();
    if input.read_exact(&mut length).is_err() {
        // The pool no longer needs this process.
        return Ok(ExitCode::SUCCESS);
    }
    let mut job = vec![0; u32::from_le_bytes(length) as usize];
    input.read_exact(&mut job)?;
    let order: Order = serde_json::from_slice(&job)?;
    // What a script makes of the objects that it is given may break an assumption of ours; that is its own doing.
    let replayed = catch_unwind(AssertUnwindSafe(|| replay(&order.job, &order.limits, &peak, prepared)));
    let answer = serde_json::to_vec(&replayed.unwrap_or_else(|_| Answer::crashed()))?;
    let mut output = std::io::stdout().lock();
    output.write_all(&u32::try_from(answer.len())?.to_le_bytes())?;
    output.write_all(&answer)?;
    output.flush()?;
    Ok(ExitCode::SUCCESS)
}

fn replay(job: &Job, limits: &ActionLimits, peak: &PeakMemory, prepared: Prepared) -> Answer {
    match job.profile {
        Profile::Mindcraft => mindcraft::run(job, limits, peak, prepared),
        Profile::Published => {
            let files = job.turns.iter().map(|turn| match turn {
                TurnInput::Code(files) => match files.as_slice() {
                    [file] => published::run(&without_fences(file), limits, peak),
                    _ => super::Replayed::default(),
                },
                TurnInput::Events(_) => super::Replayed::default(),
            });
            Answer { turns: files.collect(), end: None }
        }
    }
}
