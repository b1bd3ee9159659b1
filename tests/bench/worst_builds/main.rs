//! Searches for the builds that take each check longest, by hill climbing. `worst_builds search [SECONDS [CHECK…]]` spends
//! so many seconds on each check and size, 10 by default, and writes `found.json` beside this file. Without arguments it
//! prints how long those builds take now.
//!
//! A build is small data, so that it can be changed step by step and committed. `tests/bench/counted` counts the
//! instructions of the small ones.

#![allow(clippy::print_stdout, reason = "it prints what it measured")]

#[path = "../arguments.rs"]
mod arguments;
mod climbing;
mod found;
mod strokes;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use climbing::{beginnings, changed};
use found::{Found, SMALL, file, read};
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::voxel::Structure;
use rand_mt::Mt64;
use serde_json::json;
use strokes::{Stroke, structure};

/// The most blocks that a log may have.
const LARGE: usize = 100_000;
/// A change counts as slower only by this factor, because times are noisy.
const SLOWER: f64 = 1.03;

fn check(name: &str) -> anyhow::Result<Check> {
    serde_json::from_value(json!({ "fn": name, "args": arguments::arguments(name) })).with_context(|| name.to_owned())
}

/// Returns the least time of a few evaluations.
fn time(check: &Check, structure: &Structure) -> Duration {
    let palette = Arc::new(structure.palette().clone());
    let evaluate = |_| {
        // A structure keeps what it has looked up, so each time takes a new one.
        let fresh = Structure::new(Arc::clone(&palette), structure.entries());
        let begun = Instant::now();
        let _ = std::hint::black_box(check.evaluate(&Subject::unhurried(&fresh)));
        begun.elapsed()
    };
    (0..3).map(evaluate).min().unwrap_or_default()
}

/// Climbs from the slowest of the beginnings by changes that make a build slower.
fn climb(check: &Check, most: usize, lasts: Duration) -> (Vec<Stroke>, Duration, usize) {
    let (begun, mut random) = (Instant::now(), Mt64::new(24));
    let timed = |strokes: Vec<Stroke>| (time(check, &structure(&strokes, most)), strokes);
    let first = beginnings(most).into_iter().map(timed).max_by_key(|(took, _)| *took);
    let Some((mut slowest, mut best)) = first else { return Default::default() };
    let mut steps = 0;
    while begun.elapsed() < lasts {
        let next = changed(&best, most, &mut random);
        let built = structure(&next, most);
        if time(check, &built).as_secs_f64() > SLOWER * slowest.as_secs_f64() {
            // Both are measured again, so that one slow run does not count.
            let (before, now) = (time(check, &structure(&best, most)), time(check, &built));
            slowest = before;
            if now.as_secs_f64() > SLOWER * before.as_secs_f64() {
                (slowest, best) = (now, next);
                steps += 1;
            }
        }
    }
    (best, slowest, steps)
}

fn search(lasts: Duration, checks: &[&str]) -> anyhow::Result<()> {
    let mut all: BTreeMap<String, Found> = read().unwrap_or_default();
    let is_wanted =
        |name: &str| !name.starts_with("structural_stability") && (checks.is_empty() || checks.contains(&name));
    for (name, _) in Check::LIST.iter().filter(|(name, _)| is_wanted(name)) {
        let check = check(name)?;
        let (small, took, steps) = climb(&check, SMALL, lasts);
        println!("{name:50} {:>9} us  {SMALL} blocks, {steps} steps", took.as_micros());
        let (large, took, steps) = climb(&check, LARGE, lasts);
        println!("{name:50} {:>9} us  {LARGE} blocks, {steps} steps", took.as_micros());
        all.insert((*name).to_owned(), Found { small, large });
    }
    let lines = all.iter().map(|(name, found)| Ok(format!("  {}: {}", json!(name), serde_json::to_string(found)?)));
    let lines: Vec<String> = lines.collect::<anyhow::Result<_>>()?;
    Ok(std::fs::write(file(), format!("{{\n{}\n}}\n", lines.join(",\n")))?)
}

fn show() -> anyhow::Result<()> {
    for (name, found) in read()? {
        let check = check(&name)?;
        for (most, strokes) in [(SMALL, found.small), (LARGE, found.large)] {
            let built = structure(&strokes, most);
            println!("{name:50} {:>9} us  {} blocks", time(&check, &built).as_micros(), built.len());
        }
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [] => show(),
        ["search"] => search(Duration::from_secs(10), &[]),
        ["search", seconds, checks @ ..] => search(Duration::from_secs(seconds.parse()?), checks),
        _ => anyhow::bail!("expected nothing, or `search [SECONDS [CHECK…]]`"),
    }
}
