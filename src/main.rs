//! The `plumbline` command.

use std::process::ExitCode;

use clap::Parser as _;
use plumbline::cli::{Cli, run};

/// Requests are taken up on one thread and dropped on another; glibc's allocator makes them wait for each other.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // Where whoever reads has seen enough (`plumbline openapi | head`), the command ends quietly, as others do. A service goes on
    // without its log, and a process that feeds others sees for itself that one of them is gone.
    if !cli.command.outlives_its_readers() {
        sigpipe::reset();
    }
    let is_json = cli.command.logs_json();
    run(cli).unwrap_or_else(|error| {
        if is_broken_pipe(&error) {
            return ExitCode::SUCCESS;
        }
        if is_json {
            eprintln!("{}", serde_json::json!({ "level": "ERROR", "message": format!("{error:#}") }));
        } else {
            eprintln!("plumbline: {error:#}");
        }
        ExitCode::FAILURE
    })
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let kinds = error.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>()).map(std::io::Error::kind);
    kinds.into_iter().any(|kind| kind == std::io::ErrorKind::BrokenPipe)
}
