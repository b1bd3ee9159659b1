//! Test vectors of each kind: reading, running and comparing them.

use anyhow::{Context as _, bail};
use serde::Deserialize;
use serde_json::Value;

use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::elasticity::{Control, sph};
use plumbline_engine::grading::raw_records::RecordedProblem;
use plumbline_engine::grading::{Summary, grade_structures};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::{LogLimits, read_turns};
use plumbline_engine::tasks::published::{TaskFile, read_check, read_task_files};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Cell, Structure};

/// Relative tolerance of stresses, added to [`STRESS_ABSOLUTE_PA`].
const STRESS_RELATIVE: f64 = 1e-6;
/// Absolute tolerance of stresses, in Pa.
const STRESS_ABSOLUTE_PA: f64 = 1e-3;
/// Tolerance of means: relative to expected values above 1, absolute for smaller ones.
const MEAN_TOLERANCE: f64 = 1e-9;
/// Tolerance of means that include stress scores.
const STRESS_MEAN_TOLERANCE: f64 = 1e-6;

/// Result of running a vector.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The result is as expected.
    Match,
    /// The vector is marked as undefined, because rounding decides its value.
    NotAsserted,
    /// The result is not as expected; the text describes the difference.
    Mismatch(String),
}

/// Test vector.
#[derive(Debug)]
pub enum Case {
    /// One check on one list of blocks.
    Check { id: String, check: Check, structure: Structure, expected: f64, stress: Option<ExpectedStress> },
    /// A log and the structures after its turns.
    Merge { id: String, log: BlockLog, expected: Vec<Vec<Block>> },
    /// A structure and its stress.
    Structure { id: String, structure: Structure, stress: ExpectedStress },
    /// A run's records and its summary.
    Run { id: String, problems: Vec<RecordedProblem>, expected: Value },
    /// A task file that must be accepted.
    TaskFile { name: String, text: String },
    /// A line that holds no vector, or one that does not fit its check.
    Unreadable { id: String, fault: String },
}

/// Expected result of a stress simulation.
#[derive(Debug)]
pub struct ExpectedStress {
    max_pa: f64,
    per_block_pa: Vec<f64>,
    order_sensitive: bool,
}

type Block = (i32, i32, i32, String);

#[derive(Deserialize)]
struct CheckLine {
    id: String,
    blocks: Vec<Block>,
    expected: f64,
    max_von_mises: Option<f64>,
    #[serde(default)]
    von_mises: Vec<f64>,
    #[serde(default)]
    order_sensitive: bool,
}

#[derive(Deserialize)]
struct MergeLine {
    id: String,
    turns: Vec<Value>,
    expected: Vec<Vec<Block>>,
}

#[derive(Deserialize)]
struct StructureItem {
    name: String,
    blocks: Vec<Block>,
    oracle_max_von_mises: f64,
    #[serde(default)]
    oracle_von_mises: Vec<f64>,
    #[serde(default)]
    order_sensitive: bool,
}

fn structure(blocks: &[Block]) -> Structure {
    Structure::from_named(blocks.iter().map(|(x, y, z, name)| (Cell::new(*x, *y, *z), name.as_str())))
}

/// Reads a line of a vector file: a check or a merge.
///
/// # Errors
/// Returns an error if the line is neither.
pub fn read_line(line: &str) -> anyhow::Result<Case> {
    let value: Value = serde_json::from_str(line)?;
    if value.get("fn").is_some() {
        let mut faults = Faults::new();
        let named = serde_json::json!({ "fn": value["fn"], "args": value["args"] });
        let Some(check) = read_check(&named, &mut faults) else { bail!("{:?}", faults.list()) };
        let line: CheckLine = serde_json::from_value(value)?;
        let stress = line.max_von_mises.map(|max_pa| ExpectedStress {
            max_pa,
            per_block_pa: line.von_mises,
            order_sensitive: line.order_sensitive,
        });
        let structure = structure(&line.blocks);
        return Ok(Case::Check { id: line.id, check, structure, expected: line.expected, stress });
    }
    let line: MergeLine = serde_json::from_value(value).context("neither a check nor a merge")?;
    let turns: Vec<Value> = line.turns.into_iter().map(|events| serde_json::json!({ "events": events })).collect();
    let limits =
        LogLimits { max_turns: 1_000, max_events: 10_000_000, max_materials: 10_000, max_material_chars: 1_000 };
    let mut faults = Faults::new();
    match read_turns(&serde_json::to_vec(&turns)?, limits, &mut faults)? {
        Some(log) if faults.is_empty() => Ok(Case::Merge { id: line.id, log, expected: line.expected }),
        _ => bail!("{:?}", faults.list()),
    }
}

/// Reads a named structure.
///
/// # Errors
/// Returns an error if the item is not a named structure.
pub fn read_structure(item: &Value) -> anyhow::Result<Case> {
    let item = StructureItem::deserialize(item)?;
    let stress = ExpectedStress {
        max_pa: item.oracle_max_von_mises,
        per_block_pa: item.oracle_von_mises,
        order_sensitive: item.order_sensitive,
    };
    Ok(Case::Structure { id: item.name, structure: structure(&item.blocks), stress })
}

impl Case {
    /// Returns the kind of the vector, as shown in the table.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Check { stress: None, .. } => "checks",
            Self::Check { stress: Some(_), .. } | Self::Structure { .. } => "stress",
            Self::Merge { .. } => "merge",
            Self::Run { .. } => "run",
            Self::TaskFile { .. } => "tasks",
            Self::Unreadable { .. } => "unreadable",
        }
    }

    /// Returns the name of the vector.
    #[must_use]
    pub fn id(&self) -> &str {
        match self {
            Self::Check { id, .. }
            | Self::Merge { id, .. }
            | Self::Structure { id, .. }
            | Self::Run { id, .. }
            | Self::Unreadable { id, .. } => id,
            Self::TaskFile { name, .. } => name,
        }
    }

    /// Runs the vector and compares the result with the expected one.
    #[must_use]
    pub fn run(&self) -> Verdict {
        match self {
            Self::Check { check, structure, expected, stress, .. } => {
                run_check(check, structure, *expected, stress.as_ref())
            }
            Self::Merge { log, expected, .. } => run_merge(log, expected),
            Self::Structure { structure, stress, .. } => run_stress(structure, stress),
            Self::Run { problems, expected, .. } => run_records(problems, expected),
            Self::Unreadable { fault, .. } => Verdict::Mismatch(fault.clone()),
            Self::TaskFile { name, text } => match read_task_files(&[TaskFile { name, text }]) {
                Ok(_) => Verdict::Match,
                Err(faults) => Verdict::Mismatch(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")),
            },
        }
    }
}

fn run_check(check: &Check, structure: &Structure, expected: f64, stress: Option<&ExpectedStress>) -> Verdict {
    if let Some(stress) = stress {
        match run_stress(structure, stress) {
            Verdict::Match => {}
            other => return other,
        }
    }
    let Ok(finding) = check.evaluate(&Subject::unhurried(structure)) else {
        return Verdict::Mismatch("stopped".to_owned());
    };
    let tolerance =
        stress.map_or(0.0, |s| expected * (STRESS_RELATIVE + STRESS_ABSOLUTE_PA / s.max_pa.max(STRESS_ABSOLUTE_PA)));
    if (finding.score - expected).abs() <= tolerance {
        Verdict::Match
    } else {
        Verdict::Mismatch(format!("{} gave {}, expected {expected} ({})", check.name(), finding.score, finding.summary))
    }
}

fn run_stress(structure: &Structure, expected: &ExpectedStress) -> Verdict {
    if expected.order_sensitive {
        return Verdict::NotAsserted;
    }
    let Ok(outcome) = sph::simulate(structure.cells(), &Control::unhurried()) else {
        return Verdict::Mismatch("stopped".to_owned());
    };
    let found = if outcome.max_von_mises_pa.is_finite() { outcome.max_von_mises_pa } else { 0.0 };
    if (found - expected.max_pa).abs() > STRESS_RELATIVE * expected.max_pa + STRESS_ABSOLUTE_PA {
        return Verdict::Mismatch(format!("max {found} Pa, expected {} Pa", expected.max_pa));
    }
    let per_block = outcome.von_mises_pa.iter().zip(&expected.per_block_pa).enumerate();
    let tolerance = |wanted: f64| STRESS_RELATIVE * wanted + STRESS_ABSOLUTE_PA;
    let off =
        per_block.filter(|(_, (found, wanted))| (*found - *wanted).abs() > tolerance(**wanted)).map(|(i, _)| i).next();
    off.map_or(Verdict::Match, |i| {
        Verdict::Mismatch(format!(
            "block {i}: {} Pa, expected {} Pa",
            outcome.von_mises_pa[i], expected.per_block_pa[i]
        ))
    })
}

fn run_merge(log: &BlockLog, expected: &[Vec<Block>]) -> Verdict {
    let replayed: Vec<Vec<Block>> = Replay::new(log)
        .map(|s| s.cells().iter().enumerate().map(|(i, c)| (c.x, c.y, c.z, s.material(i).to_owned())).collect())
        .collect();
    if replayed == expected {
        Verdict::Match
    } else {
        Verdict::Mismatch(format!("replayed to {replayed:?}, expected {expected:?}"))
    }
}

fn run_records(problems: &[RecordedProblem], expected: &Value) -> Verdict {
    let mut scores = Vec::with_capacity(problems.len());
    for problem in problems {
        match grade_structures(&problem.task, problem.structures.iter().cloned(), &Control::unhurried()) {
            Ok(report) => scores.push(report.scores()),
            Err(stopped) => return Verdict::Mismatch(stopped.to_string()),
        }
    }
    let found = serde_json::to_value(Summary::of(&scores)).expect("a summary is JSON");
    let mut differences = Vec::new();
    for part in ["check_level", "problem_level", "graded", "passed_runs"] {
        compare(part, &found[part], &expected[part], &mut differences);
    }
    if differences.is_empty() { Verdict::Match } else { Verdict::Mismatch(differences.join("; ")) }
}

/// Compares every expected value with the one found; additional values are ignored.
fn compare(path: &str, found: &Value, expected: &Value, differences: &mut Vec<String>) {
    match expected {
        Value::Object(members) => {
            for (key, expected) in members {
                compare(&format!("{path}/{key}"), &found[key], expected, differences);
            }
        }
        Value::Number(number) if number.is_f64() => {
            let has_stress = ["structural_stability", "safety", "stress"].iter().any(|part| path.contains(part));
            let tolerance = if has_stress { STRESS_MEAN_TOLERANCE } else { MEAN_TOLERANCE };
            let difference = found.as_f64().zip(expected.as_f64()).map(|(a, b)| (a - b).abs() / b.abs().max(1.0));
            if difference.is_none_or(|difference| difference > tolerance) {
                differences.push(format!("{path}: {found}, expected {expected}"));
            }
        }
        Value::Number(_) => {
            if found.as_f64() != expected.as_f64() {
                differences.push(format!("{path}: {found}, expected {expected}"));
            }
        }
        _ => {
            if found != expected {
                differences.push(format!("{path}: {found}, expected {expected}"));
            }
        }
    }
}
