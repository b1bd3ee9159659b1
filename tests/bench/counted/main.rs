//! Work counted in instructions, which do not depend on how fast a machine is today: `counted check [--accept]`.
//!
//! Runs under callgrind, which is a part of valgrind: what the engine and the store do in this program (`engine`), and
//! what the service does for a request (`service`). `check` compares the counts with `counts.tsv` beside this file and
//! fails if one of them differs by more than 5 %; `--accept` writes the file anew.

#![allow(clippy::print_stdout, reason = "it prints what it counted")]

#[path = "../arguments.rs"]
mod arguments;
mod engine;
#[path = "../worst_builds/found.rs"]
mod found;
mod service;
#[path = "../worst_builds/strokes.rs"]
mod strokes;
#[path = "../submission.rs"]
mod submission;
mod table;

use std::path::Path;
use std::process::Command;

use anyhow::Context as _;

/// Number of times that everything is counted before a count that is off is a fault.
const ATTEMPTS: usize = 3;

/// Counts of one case: its name and its instructions.
pub type Count = (String, u64);

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["run"] => engine::run(),
        ["check", program] => check(Path::new(program)),
        ["check", program, "--accept"] => table::write(&counts(Path::new(program))?),
        _ => anyhow::bail!("expected `check PROGRAM [--accept]`, where PROGRAM is plumbline's own"),
    }
}

/// Counts and compares. Other work on the machine can disturb a count, so one that is off is taken again: what became
/// worse is off each time.
fn check(program: &Path) -> anyhow::Result<()> {
    if let Some(other) = table::other_compiler()? {
        anyhow::ensure!(
            std::env::var_os("CI").is_none(),
            "the counts in the table are of {other}; with this compiler, run tests/bench/counted.sh --accept and commit the table"
        );
        println!("SKIPPED: the counts in the table are of {other}");
        return Ok(());
    }
    for _ in 1..ATTEMPTS {
        match table::check(&counts(program)?) {
            Ok(()) => return Ok(()),
            Err(error) => println!("{error}\ncounted again:"),
        }
    }
    table::check(&counts(program)?)
}

fn counts(program: &Path) -> anyhow::Result<Vec<Count>> {
    let folder = tempfile::tempdir()?;
    let mut counts = engine::counts(folder.path())?;
    counts.extend(service::counts(program, folder.path())?);
    Ok(counts)
}

/// Returns the command that runs a program under callgrind, with its results in a file.
fn callgrind(out: &Path, options: &[&str], program: &Path) -> Command {
    let mut command = Command::new("valgrind");
    command.args(["--quiet", "--tool=callgrind"]).args(options);
    command.arg(format!("--callgrind-out-file={}", out.display())).arg(program);
    command
}

/// Reads the number of instructions from a file of callgrind.
fn total(file: &Path) -> anyhow::Result<u64> {
    let text = std::fs::read_to_string(file).with_context(|| format!("valgrind wrote no {}", file.display()))?;
    let totals = text.lines().find_map(|line| line.strip_prefix("totals:").or_else(|| line.strip_prefix("summary:")));
    Ok(totals.context("callgrind's file has no totals")?.trim().parse()?)
}
