//! The command line: its commands, and what each does with what it is given.

pub mod build;
pub mod conformance;
pub mod copies;
pub mod database;
pub mod demo;
pub mod epochs;
pub mod grade;
pub mod keys;
pub mod progress;
pub mod quota;
pub mod receipts;
pub mod regrade;
pub mod replay;
pub mod serve;
pub mod submit;
pub mod tasks;
pub mod validate;
pub mod verify_epoch;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::telemetry::LogFormat;

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
    /// Serve the API, the pages and the workers, from one SQLite file.
    Serve(serve::ServeArgs),
    /// Post raw records (JSONL) to a service as one run, and wait for its summary.
    Submit(submit::SubmitArgs),
    /// Grade raw records (JSONL) and print the summary of the run.
    Grade(grade::GradeArgs),
    /// Run vector files and compare with the values they carry; exit 1 on any mismatch.
    Conformance {
        /// Vector files, or folders of them.
        #[arg(required = true)]
        paths: Vec<PathBuf>,
    },
    /// List and show tasks, and work with task files.
    #[command(subcommand)]
    Tasks(tasks::TasksCommand),
    /// Print the log of a good build for a task.
    Build(build::BuildArgs),
    /// Make, rotate, list and revoke API keys.
    Keys(keys::KeysArgs),
    /// Grant owners submissions, lift their limit, and look at what they used.
    Quota(quota::QuotaArgs),
    /// Grade a suite's submissions again with this program's checks, look at what changes, and apply or discard it.
    Regrade(regrade::RegradeArgs),
    /// Announce, list and close epochs of hidden evaluation.
    Epochs(epochs::EpochsArgs),
    /// Check what a closed epoch revealed: specifications, draws and grades, all made again from its key; exit 1 where anything
    /// does not hold.
    VerifyEpoch(verify_epoch::VerifyEpochArgs),
    /// Check signed receipts, and the log that chains them; exit 1 where anything does not hold.
    VerifyReceipt(receipts::VerifyReceiptArgs),
    /// Bring a database's schema up to date; a copy is made first.
    Migrate(database::MigrateArgs),
    /// Copy the database to a file, consistently, also while the service runs.
    Backup(copies::CopyArgs),
    /// Put a backup where the database shall be.
    Restore(copies::RestoreArgs),
    /// Write runs, submissions, reports and what else boards are made of as files of JSON lines, also while the service runs.
    Export(copies::ExportArgs),
    /// Read such files into a database that has no runs yet.
    Import(copies::ExportArgs),
    /// Run action code (JavaScript) against stand-ins and print one event a line.
    Replay(replay::ReplayArgs),
    /// Print the OpenAPI document.
    Openapi,
    /// Run the one script that standard input brings, confined: a process that `serve` and `replay` start.
    #[command(name = crate::actions::child::COMMAND, hide = true)]
    RunActionCode,
}

impl Command {
    /// Whether it goes on where nobody reads what it writes.
    #[must_use]
    pub const fn outlives_its_readers(&self) -> bool {
        matches!(self, Self::Serve(_) | Self::Submit(_) | Self::Replay(_) | Self::RunActionCode)
    }

    /// Whether its log lines, and so its last words, are JSON.
    #[must_use]
    pub fn logs_json(&self) -> bool {
        matches!(self, Self::Serve(args) if args.log_format == LogFormat::Json)
    }
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
        Command::Build(args) => build::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Submit(args) => submit::run(&args),
        Command::Keys(args) => keys::run(&args),
        Command::Quota(args) => quota::run(&args),
        Command::Regrade(args) => regrade::run(&args),
        Command::Epochs(args) => epochs::run(&args),
        Command::VerifyEpoch(args) => verify_epoch::run(&args),
        Command::VerifyReceipt(args) => receipts::run(&args),
        Command::Migrate(args) => database::migrate(&args),
        Command::Backup(args) => copies::back_up(&args),
        Command::Restore(args) => copies::restore(&args),
        Command::Export(args) => copies::export_lines(&args),
        Command::Import(args) => copies::import_lines(&args),
        Command::Replay(args) => replay::run(&args),
        Command::RunActionCode => crate::actions::child::run(&crate::actions::ACTION_LIMITS),
        Command::Openapi => {
            std::io::stdout().lock().write_all(crate::http::router::document().as_bytes())?;
            Ok(ExitCode::SUCCESS)
        }
    }
}
