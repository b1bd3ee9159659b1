//! The `plumbline` command.

use std::process::ExitCode;

use clap::Parser as _;
use plumbline::cli::{Cli, run};

/// Requests are taken up on one thread and dropped on another; glibc's allocator makes them wait for each other.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    run(Cli::parse()).unwrap_or_else(|error| {
        eprintln!("plumbline: {error:#}");
        ExitCode::FAILURE
    })
}
