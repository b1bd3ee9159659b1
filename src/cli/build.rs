//! `plumbline build`: the log of a good build for a task, as an example to post or to look at.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use anyhow::bail;
use clap::{Args, ValueEnum};
use serde_json::json;

use super::tasks::{find, suite};
use plumbline_engine::builders;
use plumbline_engine::builders::saboteurs;
use plumbline_engine::builders::saboteurs::SABOTEURS;
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::block_log::Event;

/// Arguments of `build`.
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// The task, by its id or its number in the suite; `plumbline tasks list` lists them.
    #[arg(required_unless_present = "all")]
    task: Option<String>,
    /// Every task of the suite, a line each, whose build has at least this many events and at most that many.
    #[arg(long, value_names = ["LEAST", "MOST"], num_args = 2, conflicts_with_all = ["task", "format"])]
    all: Option<Vec<usize>>,
    /// Spoil it in one way, to see which checks fail; an unknown name lists them all.
    #[arg(long, value_name = "NAME")]
    saboteur: Option<String>,
    /// How the log is written.
    #[arg(long, value_enum, default_value_t = Format::Submission)]
    format: Format,
}

/// How a log is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A body for POST /v1/submissions, with compact rows.
    Submission,
    /// One event a line, in order, with its turn.
    Events,
}

/// Runs the command.
///
/// # Errors
/// Where there is no such task or saboteur.
pub fn run(args: &BuildArgs) -> anyhow::Result<ExitCode> {
    let saboteur = match &args.saboteur {
        None => None,
        Some(name) => match saboteurs::find(name) {
            None => {
                let known: Vec<String> =
                    SABOTEURS.iter().map(|one| format!("  {:<15} {}", one.name, one.what)).collect();
                bail!("there is no saboteur {name:?}; there are:\n{}", known.join("\n"));
            }
            found => found,
        },
    };
    let build = |task: &Task| -> anyhow::Result<BlockLog> {
        let log = builders::build(task)?;
        Ok(match saboteur {
            None => log,
            Some(saboteur) => saboteur.spoil(log),
        })
    };
    if let Some(&[least, most]) = args.all.as_deref() {
        let mut lines = String::new();
        for task in suite()?.tasks {
            let log = build(&task)?;
            if (least..=most).contains(&log.event_count()) {
                lines.push_str(&submission(&task, &log));
            }
        }
        std::io::stdout().lock().write_all(lines.as_bytes())?;
        return Ok(ExitCode::SUCCESS);
    }
    let task = find(args.task.as_deref().unwrap_or_default())?;
    let log = build(&task)?;
    let text = match args.format {
        Format::Submission => submission(&task, &log),
        Format::Events => events(&log),
    };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

fn submission(task: &Task, log: &BlockLog) -> String {
    format!("{}\n", json!({ "task": task.id, "turns": log.compact_turns() }))
}

fn events(log: &BlockLog) -> String {
    let mut lines = String::new();
    for (turn, events) in (1..).zip(&log.turns) {
        for event in events {
            let line = match *event {
                Event::Place { cell, material } => json!({
                    "turn": turn, "action": "place", "x": cell.x, "y": cell.y, "z": cell.z,
                    "material": log.palette.name(material),
                }),
                Event::Remove { cell } => {
                    json!({ "turn": turn, "action": "remove", "x": cell.x, "y": cell.y, "z": cell.z })
                }
            };
            // Writing to a string does not fail.
            let _ = writeln!(lines, "{line}");
        }
    }
    lines
}
