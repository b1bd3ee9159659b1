//! `plumbline failures`: lists the submissions that the service failed to grade, and has them graded after all.

use std::process::ExitCode;

use anyhow::bail;
use clap::{Args, Subcommand};
use comfy_table::{Table, presets};
use uuid::Uuid;

use super::database::DatabaseArgs;
use super::process::block_on;
use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use crate::store::failures::{FailureRow, RetryRefusal};
use plumbline_engine::text::counted;

/// Arguments of `failures`.
#[derive(Debug, Args)]
pub struct FailuresArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: FailuresCommand,
}

/// Commands on failures.
#[derive(Debug, Subcommand)]
enum FailuresCommand {
    /// List the submissions that ended as `grader_error` and can still be graded, with the reasons.
    List,
    /// Queue submissions again once the cause is mended. Each becomes a new submission with the same log, which
    /// supersedes the failed one; the service that runs on the database grades it.
    Retry {
        /// Identifiers of submissions, as shown by `list`; `--all` takes those of the whole list.
        ids: Vec<String>,
        /// All that `list` shows.
        #[arg(long, conflicts_with = "ids")]
        all: bool,
    },
}

/// Runs the command. The exit code is 1 if a submission could not be queued again.
///
/// # Errors
/// Returns an error if the database cannot be opened or fails.
pub fn run(args: &FailuresArgs) -> anyhow::Result<ExitCode> {
    if matches!(&args.command, FailuresCommand::Retry { ids, all: false } if ids.is_empty()) {
        bail!("name the submissions to queue again, or give --all; plumbline failures list shows them");
    }
    block_on(async {
        let store = args.database.open().await?;
        let done = match &args.command {
            FailuresCommand::List => list(&store).await,
            FailuresCommand::Retry { ids, all: false } => retry(&store, ids).await,
            FailuresCommand::Retry { .. } => {
                let failures = store.failures().await?;
                retry(&store, &failures.into_iter().map(|failure| failure.id).collect::<Vec<_>>()).await
            }
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let failures = store.failures().await?;
    if failures.is_empty() {
        println!("no submission waits for a failure to be mended");
        return Ok(());
    }
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["submission", "ended", "owner", "of", "reason"]);
    for failure in failures {
        let of = place_of(&failure);
        let FailureRow { id, owner, error, ended_at_ms, .. } = failure;
        table.add_row([id, rfc3339(ended_at_ms), owner.unwrap_or_default(), of, error.unwrap_or_default()]);
    }
    println!("{table}");
    Ok(())
}

/// Returns what a failed submission answers.
fn place_of(failure: &FailureRow) -> String {
    let FailureRow { run_id, instance_id, suite_id, task_number, .. } = failure;
    match (run_id, instance_id) {
        (_, Some(instance)) => format!("hidden instance {instance}"),
        (Some(run), None) => format!("run {run}, task {task_number} of {suite_id}"),
        (None, None) => format!("task {task_number} of {suite_id}"),
    }
}

async fn retry(store: &Store, ids: &[String]) -> anyhow::Result<()> {
    let mut refused = 0;
    for id in ids {
        let copy = Uuid::now_v7().to_string();
        match store.grade_after_failure(id, &copy, now_ms()).await? {
            Ok(()) => println!("{id}: queued again as {copy}"),
            Err(refusal) => {
                refused += 1;
                eprintln!("{id}: not queued: {}", why_not(refusal));
            }
        }
    }
    if refused > 0 {
        bail!("{} could not be queued again", counted(refused, "submission"));
    }
    println!("queued again: {}", ids.len());
    Ok(())
}

fn why_not(refusal: RetryRefusal) -> String {
    match refusal {
        RetryRefusal::Unknown => "there is no such submission; plumbline failures list shows what failed".to_owned(),
        RetryRefusal::NotFailed(state) => format!("it is {}; only a grader_error is retried", state.name()),
        RetryRefusal::Superseded(Some(by)) => format!("it was posted or queued again already, as {by}"),
        RetryRefusal::Superseded(None) => "it was posted again already, or its run skips the task".to_owned(),
        RetryRefusal::RunOver(state) => format!("its run is {}", state.name()),
        RetryRefusal::EntryComplete => {
            "its entry is complete, and its result may have been revealed; the answer counts as failed".to_owned()
        }
    }
}
