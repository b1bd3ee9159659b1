//! `plumbline tasks validate`: checks that a folder of family files is valid and that its tasks can be solved.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context as _, bail};
use clap::Args;
use rayon::prelude::*;

use super::{files, progress};
use plumbline_engine::builders::{build, has_builder};
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_log;
use plumbline_engine::tasks::family::SuiteSource;
use plumbline_engine::tasks::published::{TaskFile, TaskFileFault};
use plumbline_engine::tasks::{Suite, Task, embedded};
use plumbline_engine::text::{agreeing, counted};

/// Name of the hidden suite in its files.
const HIDDEN: &str = "hidden";

/// Arguments of `tasks validate`.
#[derive(Debug, Args)]
pub struct ValidateArgs {
    /// Folder with `suite.toml` and one file per family; by default, the suite of this program.
    folder: Option<PathBuf>,
    /// Read and expand the files without building and grading the tasks.
    #[arg(long)]
    no_build: bool,
}

/// Runs the command.
///
/// # Errors
/// Returns an error that lists all faults of the files, or all tasks of the latest version that their builders do not
/// solve.
pub fn run(args: &ValidateArgs) -> anyhow::Result<ExitCode> {
    let begin = Instant::now();
    let sources = match &args.folder {
        Some(folder) => vec![read_folder(folder)?],
        None => embedded::sources().map_err(|faults| told(&faults))?.into(),
    };
    let suites: Vec<Vec<Suite>> = sources.iter().map(suites_of).collect::<Result<_, _>>()?;
    let suites = suites.concat();
    let elapsed = begin.elapsed();
    for suite in &suites {
        println!(
            "{}: {}, {}, {}, {}",
            suite.id(),
            agreeing(suite.families().len(), "family", "families"),
            counted(suite.tasks.len(), "task"),
            counted(suite.instruction_count(), "instruction"),
            counted(suite.check_count(), "check")
        );
    }
    println!("read and expanded in {:.1} ms", elapsed.as_secs_f64() * 1e3);
    let Some(latest) = suites.iter().max_by_key(|suite| suite.version).filter(|_| !args.no_build) else {
        return Ok(ExitCode::SUCCESS);
    };
    let notes = not_certified(latest);
    for note in &notes {
        println!("{note}");
    }
    let unsolved = unsolved(latest);
    if !unsolved.is_empty() {
        let tasks = counted(unsolved.len(), "task");
        bail!("not solved by their builder: {tasks} of {}:\n{}", latest.id(), unsolved.join("\n"));
    }
    let which = if notes.is_empty() { "every task" } else { "every certified task" };
    if notes.len() < latest.families().len() {
        println!("{which} of {} is solved by its builder, with every check at 1", latest.id());
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns all versions of a suite.
///
/// # Errors
/// Returns an error that lists all faults of a version.
pub fn suites_of(source: &SuiteSource) -> anyhow::Result<Vec<Suite>> {
    source.versions.iter().map(|version| source.suite(version.number).map_err(|faults| told(&faults))).collect()
}

/// Returns a note for each family without a builder in this program: nothing shows that its tasks can be solved.
#[must_use]
pub fn not_certified(suite: &Suite) -> Vec<String> {
    let families = suite.families().into_iter().filter_map(|tasks| tasks.first().map(Task::family));
    let without = families.filter(|family| !is_certified(suite, family));
    without
        .map(|family| format!("{family}: not certified, no builder: nothing shows that its tasks can be solved"))
        .collect()
}

/// Returns whether a builder shows that a family can be solved. This program's builders cover only its own suites.
fn is_certified(suite: &Suite, family: &str) -> bool {
    [embedded::FULL, HIDDEN].contains(&suite.name.as_str()) && has_builder(family)
}

/// Reads the files of a suite from a folder.
///
/// # Errors
/// Returns an error if the folder cannot be read, or its files have faults.
pub fn read_folder(folder: &Path) -> anyhow::Result<SuiteSource> {
    let place = || folder.display().to_string();
    let mut texts = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(place)? {
        let path = entry.with_context(place)?.path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let text = files::text(&path)?;
            texts.push((path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(), text));
        }
    }
    texts.sort();
    let files: Vec<TaskFile<'_>> = texts.iter().map(|(name, text)| TaskFile { name, text }).collect();
    SuiteSource::read(&files).map_err(|faults| told(&faults))
}

fn told(faults: &[TaskFileFault]) -> anyhow::Error {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    anyhow::anyhow!("{}:\n{}", counted(lines.len(), "fault"), lines.join("\n"))
}

/// Returns one line for each task that its builder does not solve, with the reason.
fn unsolved(suite: &Suite) -> Vec<String> {
    let bar = progress::bar(suite.tasks.len(), "building");
    let fault = |task: &Task| {
        let found = match build(task) {
            Err(error) => Some(error.to_string()),
            Ok(log) => grade_log(task, &log, &Control::unhurried()).ok().and_then(|report| {
                let failed = report.turns.into_iter().flat_map(|turn| turn.checks).find(|c| c.finding.score < 1.0);
                failed.map(|check| format!("{}: {}", check.name, check.finding.summary))
            }),
        };
        bar.inc(1);
        found.map(|found| format!("{}: {found}", task.id))
    };
    let unsolved = suite.tasks.par_iter().filter(|task| is_certified(suite, task.family())).filter_map(fault).collect();
    bar.finish_and_clear();
    unsolved
}
