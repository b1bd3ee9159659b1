//! The command line: its commands, and what each does with what it is given.

pub mod conformance;
pub mod grade;
pub mod progress;
pub mod tasks;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Grades what AI agents build as construction engineers in Minecraft (the MineCEraft benchmark).
#[derive(Debug, Parser)]
#[command(version, about, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Grade raw records (JSONL) and print the summary of the run.
    Grade(grade::GradeArgs),
    /// Run vector files and compare with the values they carry; exit 1 on any mismatch.
    Conformance {
        /// Vector files, or folders of them.
        #[arg(required = true)]
        paths: Vec<PathBuf>,
    },
    /// Work with task files.
    #[command(subcommand)]
    Tasks(tasks::TasksCommand),
}

/// Runs a command to its end.
///
/// # Errors
/// What went wrong, in words for the person at the terminal.
pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    match cli.command {
        Command::Grade(args) => grade::run(&args),
        Command::Conformance { paths } => conformance::run(&paths),
        Command::Tasks(command) => tasks::run(command),
    }
}
