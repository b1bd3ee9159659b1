//! `plumbline build`: prints the log of a good build for a task, as an example to post or to study.

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
    /// Id of the task, or its number in the suite; see `plumbline tasks list`.
    #[arg(required_unless_present = "all")]
    task: Option<String>,
    /// Print the submissions for all tasks of the suite whose builds have LEAST to MOST events, one per line.
    #[arg(long, value_names = ["LEAST", "MOST"], num_args = 2, conflicts_with_all = ["task", "format"])]
    all: Option<Vec<usize>>,
    /// Saboteur that spoils the build in one way, to see which checks fail; an unknown name lists all saboteurs.
    #[arg(long, value_name = "NAME")]
    saboteur: Option<String>,
    /// Output format of the log.
    #[arg(long, value_enum, default_value_t = Format::Submission)]
    format: Format,
}

/// Output formats of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Request body for POST /v1/submissions, with compact rows.
    Submission,
    /// One event per line, in order, with its turn.
    Events,
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the task or the saboteur does not exist.
pub fn run(args: &BuildArgs) -> anyhow::Result<ExitCode> {
    let saboteur = match &args.saboteur {
        None => None,
        Some(name) => match saboteurs::find(name) {
            None => {
                let known: Vec<String> =
                    SABOTEURS.iter().map(|one| format!("  {:<15} {}", one.name, one.what)).collect();
                bail!("there is no saboteur {name:?}; known saboteurs:\n{}", known.join("\n"));
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
