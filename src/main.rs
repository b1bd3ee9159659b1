//! The `plumbline` command.

use std::process::ExitCode;

use plumbline::cli::{environment, run};

/// Requests are taken up on one thread and dropped on another; the allocator of glibc makes these threads wait for each
/// other.
#[cfg(feature = "jemalloc")]
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    let cli = environment::parse();
    // Files may hold unreleased grades, owners and keys: only the user who runs the program may read them.
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
    // When its reader closes the pipe (`plumbline openapi | head`), a command ends quietly, like other tools. A service
    // goes on without its log, and a process that feeds others detects closed pipes itself.
    if !cli.command.outlives_its_readers() {
        sigpipe::reset();
    }
    let (is_json, failure) = (cli.command.logs_json(), cli.command.exit_code_of_failure());
    let tell = |level: &str, message: &str| {
        if is_json {
            let time = plumbline::clock::rfc3339(plumbline::clock::now_ms());
            eprintln!("{}", serde_json::json!({ "timestamp": time, "level": level, "message": message }));
        } else {
            eprintln!("plumbline: {message}");
        }
    };
    let misspelt = environment::misspelt();
    if !misspelt.is_empty() {
        for error in &misspelt {
            tell("ERROR", error);
        }
        return ExitCode::from(environment::USAGE);
    }
    run(cli).unwrap_or_else(|error| {
        tell("ERROR", &told(&error));
        ExitCode::from(failure)
    })
}

/// Joins an error and its causes, each once: many libraries repeat the cause in their own message.
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
