//! `plumbline replay`: runs action code and prints its events, one per line.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use crate::actions::pool::Pool;
use crate::actions::{ACTION_LIMITS, Replayed};
use crate::app::replay::told;
use crate::near::counted;
use plumbline_engine::intake::code::without_fences;

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// Files of action code; `-` reads standard input.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// Runs the command. Events go to standard output, in the order of the files; dropped calls, notes and errors go to
/// standard error. The exit code is 1 if a script is stopped at a limit or is not JavaScript.
///
/// # Errors
/// Returns an error if a file cannot be read or is too large, or a script cannot be run in a process.
pub fn run(args: &ReplayArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let pool = Pool::new(1, ACTION_LIMITS);
        let who = std::sync::Arc::from("");
        let mut is_whole = true;
        for file in &args.files {
            let name = file.display().to_string();
            let code =
                if name == "-" { std::io::read_to_string(std::io::stdin()) } else { std::fs::read_to_string(file) };
            let code = code.with_context(|| name.clone())?;
            anyhow::ensure!(
                code.len() <= ACTION_LIMITS.code_bytes,
                "{name}: more than {} bytes",
                ACTION_LIMITS.code_bytes
            );
            let replayed = pool.run(&without_fences(&code), &who).await?;
            is_whole &= replayed.stopped.is_none() && !replayed.unreadable;
            match print(&name, &replayed) {
                // The reader has closed the pipe.
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(ExitCode::SUCCESS),
                printed => printed?,
            }
        }
        Ok(if is_whole { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    })
}

fn print(name: &str, replayed: &Replayed) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for event in told(replayed) {
        writeln!(out, "{}", serde_json::to_string(&event)?)?;
    }
    out.flush()?;
    for dropped in &replayed.dropped {
        eprintln!("{name}: {} dropped: {}", counted(dropped.count as usize, "call"), dropped.reason);
    }
    for note in &replayed.notes {
        eprintln!("{name}: {note}");
    }
    if let Some(error) = &replayed.error {
        let place = error.line.map(|line| format!(":{line}:{}", error.column.unwrap_or(1))).unwrap_or_default();
        eprintln!("{name}{place}: {}", error.message);
    }
    if let Some(stopped) = &replayed.stopped {
        eprintln!("{name}: stopped: {}", stopped.detail);
    }
    Ok(())
}
