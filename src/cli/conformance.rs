//! `plumbline conformance`: runs test vectors and compares the results with the published evaluator's values.

mod vectors;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use comfy_table::{Table, presets};
use rayon::prelude::*;
use serde_json::Value;

use super::{grade, progress};
use vectors::{Case, Verdict};

/// Maximum number of mismatches to print.
const PRINTED: usize = 100;

#[derive(Debug, Default)]
struct Tally {
    cases: u64,
    mismatches: u64,
    not_asserted: u64,
}

/// Runs the command.
///
/// # Errors
/// Returns an error if a path does not exist, a file cannot be read or parsed, or there are no vectors.
pub fn run(paths: &[PathBuf]) -> anyhow::Result<ExitCode> {
    let mut cases = Vec::new();
    let mut passed_over = Vec::new();
    for file in files_under(paths)? {
        let before = cases.len();
        read_file(&file, &mut cases).with_context(|| file.display().to_string())?;
        if cases.len() == before && !is_read_with_a_run(&file) {
            passed_over.push(file);
        }
    }
    if cases.is_empty() {
        bail!("no vectors found");
    }
    let bar = progress::bar(cases.len(), "vectors");
    let verdicts: Vec<(&Case, Verdict)> = cases
        .par_iter()
        .map(|case| {
            // A vector outside what the engine is made for must not hide the results of the others.
            let run = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| case.run()));
            let verdict = run.unwrap_or_else(|_| Verdict::Mismatch("the program cannot compute it".to_owned()));
            bar.inc(1);
            (case, verdict)
        })
        .collect();
    bar.finish_and_clear();
    let mut tallies: BTreeMap<&str, Tally> = BTreeMap::new();
    let mut printed = 0;
    for (case, verdict) in &verdicts {
        let tally = tallies.entry(case.kind()).or_default();
        tally.cases += 1;
        match verdict {
            Verdict::Match => {}
            Verdict::NotAsserted => tally.not_asserted += 1,
            Verdict::Mismatch(detail) => {
                tally.mismatches += 1;
                if printed < PRINTED {
                    println!("MISMATCH {}: {detail}", case.id());
                }
                printed += 1;
            }
        }
    }
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN).set_header(["kind", "cases", "mismatches", "not asserted"]);
    for (kind, tally) in &tallies {
        let numbers = [tally.cases, tally.mismatches, tally.not_asserted].map(|n| n.to_string());
        table.add_row(std::iter::once((*kind).to_owned()).chain(numbers));
    }
    println!("{table}");
    for file in passed_over {
        println!("skipped, not in a known vector format: {}", file.display());
    }
    let mismatches: u64 = tallies.values().map(|tally| tally.mismatches).sum();
    println!("{} cases, {mismatches} mismatches", verdicts.len());
    Ok(if mismatches == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Returns whether the file holds the expected summary of a run file beside it.
fn is_read_with_a_run(file: &Path) -> bool {
    let stem = file.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_suffix("_expected.json"));
    stem.is_some_and(|stem| file.with_file_name(format!("{stem}.jsonl")).exists())
}

/// Returns all named files and all files below named folders, with the entries of each folder sorted by path.
fn files_under(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut open: Vec<PathBuf> = paths.iter().rev().cloned().collect();
    while let Some(path) = open.pop() {
        if !path.exists() {
            bail!("no such file or folder: {}", path.display());
        }
        if path.is_dir() {
            let entries = std::fs::read_dir(&path).with_context(|| path.display().to_string())?;
            let mut inside = entries.map(|entry| Ok(entry?.path())).collect::<anyhow::Result<Vec<_>>>()?;
            inside.sort();
            open.extend(inside.into_iter().rev());
        } else {
            files.push(path);
        }
    }
    Ok(files)
}

/// Adds the cases of a file, detecting the format from its content; a file in no known format adds none.
fn read_file(file: &Path, cases: &mut Vec<Case>) -> anyhow::Result<()> {
    let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if extension != "json" && extension != "jsonl" {
        return Ok(());
    }
    let text = std::fs::read_to_string(file)?;
    if extension == "json" {
        return read_document(file, &text, cases);
    }
    let first = text.lines().find(|line| !line.trim().is_empty()).unwrap_or("null");
    let first: Value = serde_json::from_str(first).unwrap_or_default();
    if first.get("run_idx").is_some() {
        return read_run(file, &text, cases);
    }
    for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
        // A line that cannot be read does not hide the others.
        let case = vectors::read_line(line).unwrap_or_else(|error| Case::Unreadable {
            id: format!("{}, line {number}", file.display()),
            fault: format!("{error:#}"),
        });
        cases.push(case);
    }
    Ok(())
}

fn read_document(file: &Path, text: &str, cases: &mut Vec<Case>) -> anyhow::Result<()> {
    let value: Value = serde_json::from_str(text)?;
    let Some(first) = value.as_array().and_then(|list| list.first()) else { return Ok(()) };
    if first.get("oracle_max_von_mises").is_some() {
        for (i, item) in value.as_array().into_iter().flatten().enumerate() {
            cases.push(vectors::read_structure(item).with_context(|| format!("item {i}"))?);
        }
    } else if first.get("prompts").is_some() {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        cases.push(Case::TaskFile { name, text: text.to_owned() });
    }
    Ok(())
}

/// Reads raw records and their expected summary, from the file beside them that ends in `_expected.json` instead of
/// `.jsonl`.
fn read_run(file: &Path, text: &str, cases: &mut Vec<Case>) -> anyhow::Result<()> {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let expected_file = file.with_file_name(format!("{stem}_expected.json"));
    if !expected_file.exists() {
        return Ok(());
    }
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(&expected_file)?)?;
    let problems = grade::read_problems(text)?;
    cases.push(Case::Run { id: stem.clone(), problems: problems.clone(), expected: expected.clone() });
    for (seed, expected) in expected["lite"].as_object().into_iter().flatten() {
        let numbers = grade::lite_numbers(seed.parse().context("the seed of a Lite draw")?)?;
        let drawn = problems.iter().filter(|problem| numbers.contains(&problem.task.number)).cloned().collect();
        if expected["run_idx"] != serde_json::json!(numbers) {
            bail!("the Lite draw with seed {seed} is {numbers:?}, expected {}", expected["run_idx"]);
        }
        cases.push(Case::Run { id: format!("{stem} lite {seed}"), problems: drawn, expected: expected.clone() });
    }
    Ok(())
}
