//! The process that runs one script: it confines itself, reads the script, runs it, writes the answer, and exits.

use std::io::{Read as _, Write as _};
use std::process::ExitCode;

use serde::{Deserialize, Serialize};

use super::confine::confine;
use super::memory::PeakMemory;
use super::{ActionLimits, Replayed, engine};

/// Name of the command that runs as this process.
pub const COMMAND: &str = "run-action-code";

/// Job sent to the process: its length in bytes as a little-endian `u32`, then this struct as JSON.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Job {
    /// Action code to run.
    pub code: String,
    /// Limits on the code.
    pub limits: ActionLimits,
}

/// Runs one script, read from standard input.
///
/// # Errors
/// Returns an error if the process cannot be confined, or its input is not a job.
pub fn run(limits: &ActionLimits) -> anyhow::Result<ExitCode> {
    // Runs a script before confinement: libraries set themselves up at first use, with system calls that are then
    // forbidden.
    engine::run("skills.wait(bot, 1); new Date(0).getHours()", limits, &PeakMemory::unknown());
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
    let job: Job = serde_json::from_slice(&job)?;
    let replayed: Replayed = engine::run(&job.code, &job.limits, &peak);
    let answer = serde_json::to_vec(&replayed)?;
    let mut output = std::io::stdout().lock();
    output.write_all(&u32::try_from(answer.len())?.to_le_bytes())?;
    output.write_all(&answer)?;
    output.flush()?;
    Ok(ExitCode::SUCCESS)
}
