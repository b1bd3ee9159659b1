//! `plumbline grade`: grades raw records and prints the summary of the run.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use comfy_table::{Table, presets};
use rayon::prelude::*;
use serde::Serialize;

use super::{files, progress};
use plumbline_engine::checks::Criterion;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::raw_records::{RecordedProblem, problems, read_records};
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::grading::{ProblemScores, Summary, grade_structures};
use plumbline_engine::intake::Fault;
use plumbline_engine::tasks::{embedded, lite};
use plumbline_engine::text::agreeing;

/// Problems that a warning names.
const MOST_NAMED: usize = 10;

/// Arguments of `grade`.
#[derive(Debug, Args)]
pub struct GradeArgs {
    /// File of raw records, one JSON object per line.
    pub file: PathBuf,
    /// Print one JSON object with `check_level`, `problem_level`, `graded` and `passed_runs`.
    #[arg(long)]
    pub json: bool,
    /// Grade only the problems of the Lite draw with this seed (the published one is 42).
    #[arg(long, value_name = "SEED")]
    pub lite: Option<u64>,
}

/// Output of `--json`.
#[derive(Debug, Serialize)]
struct Output {
    #[serde(skip_serializing_if = "Option::is_none")]
    run_idx: Option<Vec<u32>>,
    #[serde(flatten)]
    summary: Summary,
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the file cannot be read, has faults, or lacks problems of the requested draw.
pub fn run(args: &GradeArgs) -> anyhow::Result<ExitCode> {
    let text = files::text(&args.file)?;
    let mut problems = read_problems(&text).with_context(|| format!("{} is faulty", args.file.display()))?;
    if problems.is_empty() {
        bail!("{} holds no record", args.file.display());
    }
    let drawn = args.lite.map(lite_numbers).transpose()?;
    if let Some(drawn) = &drawn {
        problems.retain(|problem| drawn.contains(&problem.task.number));
        if problems.len() != drawn.len() {
            bail!("the records hold {} of the {} problems of this draw", problems.len(), drawn.len());
        }
    }
    warn_of_unchecked(&problems);
    let summary = Summary::of(&grade_all(&problems));
    if args.json {
        println!("{}", serde_json::to_string_pretty(&Output { run_idx: drawn, summary })?);
    } else {
        println!("{}", table(&summary));
    }
    Ok(ExitCode::SUCCESS)
}

/// Says on standard error which problems have no checks: they count as passed, as in the published evaluator.
fn warn_of_unchecked(problems: &[RecordedProblem]) {
    let without = problems.iter().filter(|problem| problem.task.turns.iter().all(|turn| turn.checks.is_empty()));
    let mut numbers: Vec<String> = without.map(|problem| problem.task.number.to_string()).collect();
    if numbers.is_empty() {
        return;
    }
    let which = agreeing(numbers.len(), "problem has no check and counts", "problems have no checks and count");
    if numbers.len() > MOST_NAMED {
        numbers.truncate(MOST_NAMED);
        numbers.push("…".to_owned());
    }
    eprintln!("warning: {which} as passed: run_idx {}", numbers.join(", "));
}

/// Reads raw records and groups them into problems.
///
/// # Errors
/// Returns one error that lists all faults of the text.
pub fn read_problems(text: &str) -> anyhow::Result<Vec<RecordedProblem>> {
    let told = |faults: Vec<Fault>| {
        let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
        anyhow::anyhow!("{}", lines.join("\n"))
    };
    problems(read_records(text).map_err(told)?).map_err(told)
}

/// Returns the numbers of the problems in a Lite draw, in the order of the draw.
///
/// # Errors
/// Returns an error if the suite in the binary has faults.
pub fn lite_numbers(seed: u64) -> anyhow::Result<Vec<u32>> {
    let full = embedded::suite(embedded::PUBLISHED_VERSION).map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    Ok(lite::draw(&full, seed).into_iter().map(|task| task.number).collect())
}

/// Grades problems on all cores.
#[must_use]
pub fn grade_all(problems: &[RecordedProblem]) -> Vec<ProblemScores> {
    let bar = progress::bar(problems.len(), "grading");
    let scores = problems
        .par_iter()
        .filter_map(|problem| {
            let report = grade_structures(&problem.task, problem.structures.iter().cloned(), &Control::unhurried());
            bar.inc(1);
            // Grading fails only when it is stopped, which never happens here.
            report.ok().map(|report| report.scores())
        })
        .collect();
    bar.finish_and_clear();
    scores
}

fn percent(rate: Option<f64>) -> String {
    rate.map_or_else(|| "n/a".to_owned(), |rate| format!("{:.1} %", rate * 100.0))
}

fn table(summary: &Summary) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["", "problems passed", "of", "rate", "checks", "mean score of checks"]);
    let level = &summary.problem_level;
    let row = |name: &str, problems: &ProblemRate, checks: String, mean: String| {
        [name.to_owned(), problems.pass.to_string(), problems.of.to_string(), percent(problems.rate), checks, mean]
    };
    table.add_row(row("overall", &level.overall, String::new(), String::new()));
    let dimensions = [
        ("accuracy", &level.per.accuracy, &summary.check_level.accuracy),
        ("safety", &level.per.safety, &summary.check_level.safety),
        ("planning", &level.per.planning, &summary.check_level.planning),
    ];
    for (name, problems, checks) in dimensions {
        table.add_row(row(name, problems, checks.rows.to_string(), percent(checks.mean)));
    }
    for criterion in Criterion::ALL {
        let checks = summary.check_level.criterion(criterion);
        let problems = level.per.criterion(criterion);
        table.add_row(row(criterion.name(), problems, checks.rows.to_string(), percent(checks.mean)));
    }
    table
}
