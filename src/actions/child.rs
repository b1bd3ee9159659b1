//! The process that runs one script: it confines itself, reads the script, runs it, answers, and ends.

use std::io::{Read as _, Write as _};
use std::process::ExitCode;

use serde::{Deserialize, Serialize};

use super::confine::confine;
use super::memory::PeakMemory;
use super::{ActionLimits, Replayed, engine};

/// Name of the command that is this process.
pub const COMMAND: &str = "run-action-code";

/// What the process is sent: the length in four bytes, the smaller first, and this as JSON.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Job {
    /// The code.
    pub code: String,
    /// What it may use.
    pub limits: ActionLimits,
}

/// Runs the one script that standard input brings.
///
/// # Errors
/// Where the process cannot be confined, or is sent something else.
pub fn run(limits: &ActionLimits) -> anyhow::Result<ExitCode> {
    // What libraries set up at their first use they set up before that needs system calls that are no longer there.
    engine::run("skills.wait(bot, 1); new Date(0).getHours()", limits, &PeakMemory::unknown());
    let peak = PeakMemory::of_this_process();
    confine(limits)?;
    let mut length = [0; 4];
    let mut input = std::io::stdin().lock();
    if input.read_exact(&mut length).is_err() {
        // It was not needed.
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
