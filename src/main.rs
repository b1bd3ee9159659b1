//! The `plumbline` command.

use std::process::ExitCode;

use clap::Parser as _;
use plumbline::cli::{Cli, run};

/// Requests are taken up on one thread and dropped on another; glibc's allocator makes them wait for each other.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // What it writes may hold grades that are not told yet, owners and keys: for its own user alone.
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
    // Where whoever reads has seen enough (`plumbline openapi | head`), the command ends quietly, as others do. A service goes on
    // without its log, and a process that feeds others sees for itself that one of them is gone.
    if !cli.command.outlives_its_readers() {
        sigpipe::reset();
    }
    let is_json = cli.command.logs_json();
    run(cli).unwrap_or_else(|error| {
        if is_json {
            let time = plumbline::clock::rfc3339(plumbline::clock::now_ms());
            eprintln!("{}", serde_json::json!({ "timestamp": time, "level": "ERROR", "message": told(&error) }));
        } else {
            eprintln!("plumbline: {}", told(&error));
        }
        ExitCode::FAILURE
    })
}

/// An error with its causes, each once: many a library tells those of its own as well.
fn told(error: &anyhow::Error) -> String {
    let mut told = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !told.contains(&cause) {
            told.push_str(if told.is_empty() { "" } else { ": " });
            told.push_str(&cause);
        }
    }
    told
}
