//! The `plumbline` command.

use std::process::ExitCode;

use clap::Parser as _;
use plumbline::cli::{Cli, run};

fn main() -> ExitCode {
    run(Cli::parse()).unwrap_or_else(|error| {
        eprintln!("plumbline: {error:#}");
        ExitCode::FAILURE
    })
}
