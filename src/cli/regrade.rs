//! `plumbline regrade`: regrades a suite's submissions with this program's checks beside the current results, shows
//! what changes, and applies or discards it.

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use comfy_table::{Table, presets};
use rayon::prelude::*;
use uuid::Uuid;

use super::database::DatabaseArgs;
use super::process::block_on;
use super::progress::bar;
use crate::app::boards::cache::compared;
use crate::app::signing::{Others, signing};
use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use crate::store::boards::BoardCursor;
use crate::store::regrades::{Difference, ToRegrade};
use crate::store::reports::PackedReport;
use crate::store::states::RegradeState;
use crate::threads::yield_to_others;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::{Summary, grade_hashed};
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::text::{agreeing, counted};

/// Number of submissions graded between two writes.
const CHUNK: i64 = 200;
/// Niceness of this process, so that a service on the same machine goes first.
const NICENESS: i32 = 10;
/// Share of a suite that a run must cover to have a rank here, as where `serve --board-coverage` is not set.
const WHOLE_SUITE: f64 = 1.0;
/// Maximum number of flipped submissions to list.
const LISTED: usize = 50;

/// Arguments of `regrade`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct RegradeArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: Option<RegradeCommand>,
    #[command(flatten)]
    compute: ComputeArgs,
}

#[derive(Debug, Args)]
struct ComputeArgs {
    /// Suite whose submissions are regraded, as name@version.
    #[arg(long)]
    suite: Option<String>,
    /// Reason, recorded with every row that changes.
    #[arg(long)]
    reason: Option<String>,
    /// Person who regrades, recorded with every row that changes.
    #[arg(long, default_value = "operator")]
    actor: String,
}

/// Commands on computed regrades.
#[derive(Debug, Subcommand)]
enum RegradeCommand {
    /// List regrades.
    List,
    /// Show what a regrade would change.
    Show(Named),
    /// Apply a regrade: boards change at once, and old reports are kept.
    Apply(Named),
    /// Discard a regrade.
    Discard(Named),
}

#[derive(Debug, Args)]
struct Named {
    /// Id of the regrade.
    id: String,
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the database cannot be opened, there is no such suite or regrade, or a submission cannot be
/// graded.
pub fn run(args: &RegradeArgs) -> anyhow::Result<ExitCode> {
    // Lets a service on this machine go first. A failure does not change the results.
    yield_to_others(NICENESS);
    block_on(async {
        let store = args.database.open().await?;
        let done = match &args.command {
            None => compute(&store, &args.database, &args.compute).await,
            Some(RegradeCommand::List) => list(&store).await,
            Some(RegradeCommand::Show(named)) => show(&store, &named.id).await,
            Some(RegradeCommand::Apply(named)) => apply(&store, &named.id).await,
            Some(RegradeCommand::Discard(named)) => discard(&store, &named.id).await,
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn compute(store: &Store, database: &DatabaseArgs, args: &ComputeArgs) -> anyhow::Result<()> {
    let Some(name) = &args.suite else { bail!("--suite: name the suite to regrade (name@version)") };
    let Some(reason) = args.reason.as_deref().map(str::trim).filter(|reason| !reason.is_empty()) else {
        bail!("--reason: must not be empty; it is recorded with every row that changes");
    };
    let catalogue = store.catalogue();
    let entry = catalogue.suite(name).with_context(|| format!("there is no suite {name:?}"))?;
    let suite_id = entry.id.clone();
    let id = Uuid::now_v7().to_string();
    store.begin_regrade(&id, &suite_id, reason, &args.actor, now_ms()).await?;
    let progress = bar(0, "regrading");
    let mut after = String::new();
    loop {
        let chunk = store.to_regrade(&suite_id, &after, CHUNK).await?;
        let Some(last) = chunk.last() else { break };
        after.clone_from(&last.submission_id);
        let graded: Vec<(String, PackedReport)> =
            chunk.par_iter().map(|one| grade(entry, one)).collect::<anyhow::Result<_>>()?;
        progress.inc(graded.len() as u64);
        if !store.put_regraded(&id, graded).await? {
            bail!("the regrade {id} was discarded while it was computed");
        }
    }
    progress.finish_and_clear();
    if !store.mark_ready(&id).await? {
        bail!("the regrade {id} was discarded while it was computed");
    }
    show(store, &id).await?;
    // The URL of a server may hold a password, and is usually in the environment.
    let file = database.database.file().map(|file| format!(" --database {}", file.display())).unwrap_or_default();
    println!("\nplumbline regrade apply {id}{file}\nplumbline regrade discard {id}{file}");
    Ok(())
}

fn grade(entry: &Entry, one: &ToRegrade) -> anyhow::Result<(String, PackedReport)> {
    let begun = Instant::now();
    let (task, hash) = entry.task_numbered(one.task_number).context("a submission to a task that does not exist")?;
    let report = grade_hashed(task, hash, &one.read_log()?, &Control::unhurried());
    let report = report.map_err(|_stopped| anyhow::anyhow!("grading {} stopped", one.submission_id))?;
    let took = i64::try_from(begun.elapsed().as_micros()).unwrap_or(i64::MAX);
    Ok((one.submission_id.clone(), PackedReport::of(&report, took)?))
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["id", "suite", "checks", "state", "begun", "actor", "reason"]);
    for row in store.regrades().await? {
        let begun = rfc3339(row.created_at_ms);
        table.add_row([
            row.id,
            row.suite_id,
            row.checks_version.to_string(),
            row.state.name().to_owned(),
            begun,
            row.actor,
            row.reason,
        ]);
    }
    println!("{table}");
    Ok(())
}

async fn show(store: &Store, id: &str) -> anyhow::Result<()> {
    let all = store.regrades().await?;
    let regrade = all.iter().find(|row| row.id == id).with_context(|| format!("there is no regrade {id:?}"))?;
    let catalogue = store.catalogue();
    let entry = catalogue.suite(&regrade.suite_id).context("the suite of the regrade no longer exists")?;
    println!("{} of {}: {} ({})", regrade.id, regrade.suite_id, regrade.state.name(), regrade.reason);
    let differences = store.differences(id).await?;
    let flips: Vec<&Difference> = differences.iter().filter(|d| d.before != d.after).collect();
    let (differing, flipping) = (counted(differences.len(), "submission"), counted(flips.len(), "problem"));
    println!("{differing} with other scores; {flipping} with another verdict");
    for flip in flips.iter().take(LISTED) {
        let task = entry.task_numbered(flip.task_number).map(|(task, _)| &task.id);
        let becomes = if flip.after { "solved" } else { "not solved" };
        println!("  {} {}: {becomes}  {}", flip.task_number, task.map_or("", String::as_str), flip.submission_id);
    }
    if flips.len() > LISTED {
        println!("  and {} more", flips.len() - LISTED);
    }
    ranks(store, id, entry, &differences).await
}

/// Prints how the rates and ranks of the runs change that the board compares.
async fn ranks(store: &Store, id: &str, entry: &Arc<Entry>, differences: &[Difference]) -> anyhow::Result<()> {
    let all = store.board_update(&entry.id, &entry.suite.tasks, BoardCursor::default()).await?;
    let rows = compared(entry, WHOLE_SUITE, all);
    let before: Vec<f64> = rows.iter().map(|row| row.rate().unwrap_or(-1.0)).collect();
    let mut after = before.clone();
    let mut others = 0;
    let runs: BTreeSet<&String> = differences.iter().filter_map(|difference| difference.run_id.as_ref()).collect();
    for run in runs {
        let Some(place) = rows.iter().position(|row| row.run == *run) else {
            others += 1;
            continue;
        };
        let summary = Summary::of(&store.regraded_problems(id, run).await?);
        after[place] = summary.problem_level.overall.pass as f64 / entry.suite.tasks.len() as f64;
    }
    // Only runs with prompts of the same track are compared.
    let rank = |rates: &[f64], place: usize| {
        let is_better = |(row, rate): &(&Arc<Standing>, &f64)| row.track == rows[place].track && **rate > rates[place];
        1 + rows.iter().zip(rates).filter(is_better).count()
    };
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["run", "agent", "overall before", "after", "rank before", "after"]);
    for (place, row) in rows.iter().enumerate() {
        let (was, is) = (rank(&before, place), rank(&after, place));
        if before[place] == after[place] && was == is {
            continue;
        }
        let percent = |rate: f64| format!("{:.1} %", rate * 100.0);
        table.add_row([
            row.run.clone(),
            row.agent.clone(),
            percent(before[place]),
            percent(after[place]),
            was.to_string(),
            is.to_string(),
        ]);
    }
    if table.row_count() == 0 {
        println!("no run on the board moves");
    } else {
        println!("{table}");
    }
    if others > 0 {
        let runs = counted(others, "run");
        println!(
            "not compared on the board, because it is unfinished, incomplete, hidden or withdrawn: {runs} with differences"
        );
    }
    Ok(())
}

async fn apply(store: &Store, id: &str) -> anyhow::Result<()> {
    let all = store.regrades().await?;
    let regrade = all.iter().find(|row| row.id == id).with_context(|| format!("there is no regrade {id:?}"))?;
    let catalogue = store.catalogue();
    let entry = catalogue.suite(&regrade.suite_id).context("the suite of the regrade no longer exists")?;
    let left_out = store.left_out(id).await?;
    if regrade.state == RegradeState::Ready && left_out > 0 {
        let left_out = agreeing(left_out, "submission was", "submissions were");
        bail!("{left_out} graded by other checks in the meantime; regrade again before applying");
    }
    // The actions on boards are signed with the key that the service signs with.
    signing(store, false, Others::MaySign).await?;
    match store.apply_regrade(id, &entry.suite.tasks, now_ms()).await? {
        Some(runs) => println!("applied; {} new results", agreeing(runs, "finished run has", "finished runs have")),
        None => bail!("the regrade is {}, not ready", regrade.state.name()),
    }
    Ok(())
}

async fn discard(store: &Store, id: &str) -> anyhow::Result<()> {
    if !store.discard(id, now_ms()).await? {
        bail!("there is no regrade {id:?} to discard");
    }
    println!("discarded");
    Ok(())
}
