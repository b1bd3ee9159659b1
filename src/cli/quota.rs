//! `plumbline quota`: grants submissions to owners, lifts their limits and shows their usage.

use std::process::ExitCode;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::database::DatabaseArgs;
use super::process::block_on;
use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use plumbline_engine::text::{counted, did_you_mean};

/// Arguments of `quota`.
#[derive(Debug, Args)]
pub struct QuotaArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: QuotaCommand,
}

/// Commands on quotas.
#[derive(Debug, Subcommand)]
enum QuotaCommand {
    /// Grant submissions to an owner. An owner without any grant has no limit.
    Grant {
        /// Name of the owner.
        #[arg(long)]
        name: String,
        /// Number of submissions to add; a negative number takes submissions away.
        #[arg(long, allow_negative_numbers = true)]
        submissions: i64,
        /// Reason, recorded in the ledger.
        #[arg(long)]
        reason: String,
        /// Accept an owner who has no key yet.
        #[arg(long)]
        new_owner: bool,
    },
    /// Remove the limit of an owner, who may then submit without limit.
    Lift {
        /// Name of the owner.
        #[arg(long)]
        name: String,
        /// Reason, recorded in the ledger.
        #[arg(long)]
        reason: String,
    },
    /// Show what an owner was granted and has used, with the latest ledger entries.
    Show {
        /// Name of the owner.
        #[arg(long)]
        name: String,
    },
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the database cannot be opened, the owner is unknown, or the change is not allowed.
pub fn run(args: &QuotaArgs) -> anyhow::Result<ExitCode> {
    block_on(async {
        let store = args.database.open().await?;
        let done = match &args.command {
            QuotaCommand::Grant { name, submissions, reason, new_owner } => {
                if !new_owner {
                    must_be_known(&store, name).await?;
                }
                grant(&store, name, *submissions, reason).await
            }
            QuotaCommand::Lift { name, reason } => lift(&store, name, reason).await,
            QuotaCommand::Show { name } => show(&store, name).await,
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Rejects the name of an unknown owner, which is probably misspelt.
async fn must_be_known(store: &Store, name: &str) -> anyhow::Result<()> {
    if store.knows_owner(name).await? {
        return Ok(());
    }
    let owners = store.owners().await?;
    let near = did_you_mean(name, owners.iter().map(String::as_str));
    bail!("there is no owner {name:?}{near} (`quota grant --new-owner` accepts an owner who has no key yet)");
}

async fn lift(store: &Store, name: &str, reason: &str) -> anyhow::Result<()> {
    must_be_known(store, name).await?;
    if reason.trim().is_empty() {
        bail!("--reason: must not be empty; it is recorded in the ledger");
    }
    if !store.lift_quota(name, reason, now_ms()).await? {
        bail!("{name} already has no limit");
    }
    show(store, name).await
}

async fn grant(store: &Store, name: &str, submissions: i64, reason: &str) -> anyhow::Result<()> {
    const MAX_SUBMISSIONS: i64 = 1_000_000_000_000;
    if reason.trim().is_empty() {
        bail!("--reason: must not be empty; it is recorded in the ledger");
    }
    if submissions == 0 || submissions.abs() > MAX_SUBMISSIONS {
        bail!("--submissions: expected a number other than 0, between -{MAX_SUBMISSIONS} and {MAX_SUBMISSIONS}");
    }
    if submissions < 0 && store.quota(name).await?.granted.is_none() {
        bail!("--submissions: {name} has no grant to take from; the first grant must be positive");
    }
    store.grant(name, submissions, reason, now_ms()).await?;
    show(store, name).await
}

async fn show(store: &Store, name: &str) -> anyhow::Result<()> {
    const ENTRIES: i64 = 20;
    must_be_known(store, name).await?;
    let quota = store.quota(name).await?;
    let granted = quota.granted.map_or_else(|| "no limit".to_owned(), |granted| granted.to_string());
    let before = match quota.used_before {
        0 => String::new(),
        before => format!(" ({before} of these before the first grant)"),
    };
    let left = quota.left().map(|left| format!(", left {left}")).unwrap_or_default();
    println!("{name}: granted {granted}{left}; reserved {}, charged {}{before}", quota.reserved, quota.charged);
    if quota.debt() > 0 {
        println!("{name} owes {}: a new grant settles that first", counted(quota.debt(), "submission"));
    }
    for entry in store.quota_entries(name, i64::MAX, ENTRIES).await? {
        let of = entry.submission_id.unwrap_or_default();
        println!("{}  {:7} {:>6}  {of:36}  {}", rfc3339(entry.at_ms), entry.kind, entry.units, entry.reason);
    }
    Ok(())
}
