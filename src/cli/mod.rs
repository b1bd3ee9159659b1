//! The command line: the commands, their arguments and what they do.

pub mod archive;
mod archived_log;
pub mod build;
pub mod check;
pub mod checksums;
pub mod conformance;
pub mod copies;
pub mod database;
pub mod demo;
pub mod environment;
mod epoch_page;
pub mod epochs;
mod evidence;
pub mod failures;
mod files;
mod given_receipts;
pub mod grade;
pub mod keys;
pub mod process;
pub mod progress;
pub mod quota;
pub mod receipts;
pub mod regrade;
pub mod replay;
pub mod serve;
pub mod submit;
pub mod tasks;
pub mod validate;
pub mod verify_draw;
pub mod verify_epoch;
pub mod webhooks;
pub mod witness;
pub mod work;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::telemetry::LogFormat;

/// Grade what AI agents build as construction engineers in Minecraft (the MineCEraft benchmark).
#[derive(Debug, Parser)]
#[command(version, about, propagate_version = true)]
pub struct Cli {
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the service: the API, the web pages and the grading workers, on a SQLite file or a PostgreSQL database.
    Serve(serve::ServeArgs),
    /// Grade submissions beside other nodes on the same PostgreSQL database, and serve only probes and metrics.
    Work(work::WorkArgs),
    /// Post raw records (JSONL) to a service as one run and wait for its summary.
    Submit(submit::SubmitArgs),
    /// Grade raw records (JSONL) and print the summary of the run.
    Grade(grade::GradeArgs),
    /// Run test vectors and compare the results with the values they carry; exit 1 on any mismatch.
    Conformance {
        /// Vector files, or folders that contain them.
        #[arg(required = true)]
        paths: Vec<PathBuf>,
    },
    /// List and show tasks; validate and import task files.
    #[command(subcommand)]
    Tasks(tasks::TasksCommand),
    /// Print the log of a good build for a task.
    Build(build::BuildArgs),
    /// Create, rotate, list and revoke API keys.
    Keys(keys::KeysArgs),
    /// Grant submissions to owners, lift their limits and show their usage.
    Quota(quota::QuotaArgs),
    /// List and disable webhooks of all owners.
    Webhooks(webhooks::WebhooksArgs),
    /// List submissions that the service failed to grade, and queue them again once the cause is mended.
    Failures(failures::FailuresArgs),
    /// Regrade a suite's submissions with this program's checks, review what changes, and apply or discard it.
    Regrade(regrade::RegradeArgs),
    /// Announce, list and close epochs of hidden evaluation.
    Epochs(epochs::EpochsArgs),
    /// Follow the transparency log of a service, check that it only grows, and cosign its checkpoints; exit 1 if it is
    /// not what it was, 2 if it could not be checked.
    Witness(witness::WitnessArgs),
    /// Check the proof of a draw of hidden instances against the commitment of its epoch; exit 1 if it does not hold, 2
    /// if it could not be checked.
    VerifyDraw(verify_draw::VerifyDrawArgs),
    /// Verify the reveal of a closed epoch by recomputing its specifications, draws and grades from its key; exit 1 if
    /// anything does not match, 2 if it could not be checked.
    VerifyEpoch(verify_epoch::VerifyEpochArgs),
    /// Download everything that a closed epoch published as one file, which can be verified when the service is gone.
    ArchiveEpoch(archive::ArchiveArgs),
    /// Verify the archive of an epoch as verify-epoch does, with the transparency log and its witnesses; exit 1 if
    /// anything does not match, 2 if it could not be checked.
    VerifyArchive(archive::VerifyArchiveArgs),
    /// Verify signed receipts and the log that chains them; exit 1 if anything does not verify, 2 if it
    /// could not be checked.
    VerifyReceipt(receipts::VerifyReceiptArgs),
    /// Bring a database's schema up to date, after making a copy.
    Migrate(database::MigrateArgs),
    /// Read everything in a database and say what is damaged; the service may keep running. Exit 1 if anything is, 2 if
    /// the database could not be read.
    Check(check::CheckArgs),
    /// Write a consistent copy of the database to a file; the service may keep running.
    Backup(copies::CopyArgs),
    /// Restore the database from a backup.
    Restore(copies::RestoreArgs),
    /// Export runs, submissions, reports and all other board data as files of JSON lines; the service may keep running.
    Export(copies::LinesArgs),
    /// Import exported files into a database that has no runs yet.
    Import(copies::LinesArgs),
    /// Run action code (JavaScript) against stand-ins and print one event per line.
    Replay(replay::ReplayArgs),
    /// Print the OpenAPI document.
    Openapi,
    /// Fork a confined process for each script that `serve` and `replay` send on standard input.
    #[command(name = crate::actions::child::COMMAND, hide = true)]
    RunActionCode,
}

impl Command {
    /// Returns whether the command goes on after the reader of its output is gone.
    #[must_use]
    pub const fn outlives_its_readers(&self) -> bool {
        matches!(self, Self::Serve(_) | Self::Work(_) | Self::Submit(_) | Self::Replay(_) | Self::RunActionCode)
    }

    /// Returns the exit code of a command that fails. Commands that verify exit with 1 for what does not hold, so that
    /// it can be told from what could not be checked.
    #[must_use]
    pub const fn exit_code_of_failure(&self) -> u8 {
        match self {
            Self::Witness(_)
            | Self::VerifyDraw(_)
            | Self::VerifyEpoch(_)
            | Self::VerifyArchive(_)
            | Self::VerifyReceipt(_)
            | Self::Check(_) => 2,
            Self::Grade(_)
            | Self::Conformance { .. }
            | Self::Tasks(_)
            | Self::Build(_)
            | Self::Serve(_)
            | Self::Work(_)
            | Self::Submit(_)
            | Self::Keys(_)
            | Self::Quota(_)
            | Self::Failures(_)
            | Self::Webhooks(_)
            | Self::Regrade(_)
            | Self::Epochs(_)
            | Self::ArchiveEpoch(_)
            | Self::Migrate(_)
            | Self::Backup(_)
            | Self::Restore(_)
            | Self::Export(_)
            | Self::Import(_)
            | Self::Replay(_)
            | Self::Openapi
            | Self::RunActionCode => 1,
        }
    }

    /// Returns whether log lines, and so the final error message, are JSON.
    #[must_use]
    pub fn logs_json(&self) -> bool {
        match self {
            Self::Serve(args) => args.log_format == LogFormat::Json,
            Self::Work(args) => args.log_format == LogFormat::Json,
            _ => false,
        }
    }
}

/// Runs a command to completion.
///
/// # Errors
/// Returns an error that tells the person at the terminal what went wrong.
pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    match cli.command {
        Command::Grade(args) => grade::run(&args),
        Command::Conformance { paths } => conformance::run(&paths),
        Command::Tasks(command) => tasks::run(command),
        Command::Build(args) => build::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Work(args) => work::run(&args),
        Command::Submit(args) => submit::run(&args),
        Command::Keys(args) => keys::run(&args),
        Command::Quota(args) => quota::run(&args),
        Command::Failures(args) => failures::run(&args),
        Command::Webhooks(args) => webhooks::run(&args),
        Command::Regrade(args) => regrade::run(&args),
        Command::Epochs(args) => epochs::run(&args),
        Command::Witness(args) => witness::run(&args),
        Command::VerifyDraw(args) => verify_draw::run(&args),
        Command::VerifyEpoch(args) => verify_epoch::run(&args),
        Command::ArchiveEpoch(args) => archive::run(&args),
        Command::VerifyArchive(args) => archive::verify(&args),
        Command::VerifyReceipt(args) => receipts::run(&args),
        Command::Migrate(args) => database::migrate(&args),
        Command::Check(args) => check::run(&args),
        Command::Backup(args) => copies::back_up(&args),
        Command::Restore(args) => copies::restore(&args),
        Command::Export(args) => copies::export_lines(&args),
        Command::Import(args) => copies::import_lines(&args),
        Command::Replay(args) => replay::run(&args),
        // Its standard error is no place for messages.
        Command::RunActionCode => {
            Ok(crate::actions::child::run(&crate::actions::ACTION_LIMITS).unwrap_or(ExitCode::FAILURE))
        }
        Command::Openapi => {
            std::io::stdout().lock().write_all(crate::http::router::document().as_bytes())?;
            Ok(ExitCode::SUCCESS)
        }
    }
}
