//! Raw records of the published pipeline (`docs/rules.md#formats`): one line of JSON per turn, with its checks and
//! cumulative blocks.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use crate::checks::Check;
use crate::intake::not_json::on_its_line;
use crate::intake::{Fault, Faults};
use crate::tasks::published::read_checks;
use crate::tasks::{Instruction, Task};
use crate::text::reworded;
use crate::voxel::{Cell, Structure};

/// Record of one turn of one problem.
#[derive(Debug, Clone)]
pub struct RawRecord {
    /// Number of the problem, from 1.
    pub run_idx: u32,
    /// Number of the turn, from 1.
    pub turn_idx: u32,
    /// Number of turns of the problem.
    pub n_turns: u32,
    /// Instruction; empty if the record does not give it.
    pub prompt: String,
    /// Checks of the turn.
    pub checks: Vec<Check>,
    /// Blocks that stand after the turn, in the order given.
    pub structure: Structure,
    /// Name of the model that built, if the record gives it.
    pub builder_model: Option<String>,
    /// Line of the record in the file, from 1.
    pub line: u64,
}

#[derive(Deserialize)]
struct Line {
    run_idx: u32,
    turn_idx: u32,
    n_turns: u32,
    #[serde(default)]
    prompt: Option<String>,
    checks: Value,
    coords: Vec<Block>,
    #[serde(default)]
    builder_model: Option<String>,
}

#[derive(Deserialize)]
struct Block {
    x: Coordinate,
    y: Coordinate,
    z: Coordinate,
    #[serde(default)]
    material: Option<String>,
}

/// An integer, which may be written as `3.0`.
#[derive(Deserialize)]
#[serde(try_from = "f64")]
struct Coordinate(i32);

impl TryFrom<f64> for Coordinate {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        if value.fract() == 0.0 && value.abs() <= f64::from(i32::MAX) {
            Ok(Self(value as i32))
        } else {
            Err(format!("{value} is not a coordinate: expected an integer"))
        }
    }
}

/// A problem assembled from its records.
#[derive(Debug, Clone)]
pub struct RecordedProblem {
    /// Prompts and checks as a task.
    pub task: Task,
    /// Structure after each turn.
    pub structures: Vec<Structure>,
}

/// Reads the records of a text in JSON Lines. Skips blank lines.
///
/// # Errors
/// Returns the faults of all lines with their locations, but lists at most [`Faults::KEPT`] of them.
pub fn read_records(text: &str) -> Result<Vec<RawRecord>, Vec<Fault>> {
    let mut faults = Faults::new();
    let mut records = Vec::new();
    // A document that is set out over several lines would be a fault of each.
    let first = text.lines().enumerate().find(|(_, line)| !line.trim().is_empty());
    if let Some((i, "{" | "[")) = first.map(|(i, line)| (i, line.trim())) {
        faults.enter_line(i as u64 + 1);
        let remedy = "`jq -c .` writes each on one line, and `jq -c '.[]'` those of an array";
        faults.add(format!(
            "expected an object on a line of its own for each turn, found one over several lines: {remedy}"
        ));
        return Err(faults.into_list());
    }
    for (number, line) in (1u64..).zip(text.lines()) {
        if line.trim().is_empty() {
            continue;
        }
        faults.enter_line(number);
        // serde takes a list for the members of a record, in their order.
        if line.trim_start().starts_with('[') {
            faults.add("expected an object on a line of its own for each turn, found an array: `jq -c '.[]'` makes lines of it");
            continue;
        }
        let mut json = serde_json::Deserializer::from_str(line);
        match serde_path_to_error::deserialize::<_, Line>(&mut json) {
            Err(error) => {
                let path = error.path().to_string();
                let place = if path == "." { String::new() } else { format!("{path}: ") };
                let error = error.into_inner();
                let why =
                    if error.is_data() { reworded(&error.to_string()) } else { on_its_line(line.as_bytes(), &error) };
                faults.add(format!("{place}{why}"));
            }
            Ok(line) => records.extend(record(line, number, &mut faults)),
        }
    }
    if faults.is_empty() { Ok(records) } else { Err(faults.into_list()) }
}

fn record(line: Line, number: u64, faults: &mut Faults) -> Option<RawRecord> {
    faults.enter_key("checks");
    let checks = read_checks(&line.checks, faults);
    faults.leave();
    if line.run_idx == 0 {
        faults.add_at("run_idx", "problems are numbered from 1");
    }
    if line.turn_idx == 0 || line.turn_idx > line.n_turns {
        let (turn, turns) = (line.turn_idx, line.n_turns);
        faults.add_at("turn_idx", format!("there is no turn {turn} of {turns}; turns are numbered from 1"));
    }
    faults.enter_key("coords");
    for (i, block) in line.coords.iter().enumerate() {
        if !block.cell().in_range() {
            faults.add_at(&i.to_string(), format!("{:?} is out of range", <[i32; 3]>::from(block.cell())));
        }
    }
    faults.leave();
    let blocks = line.coords.iter().map(|block| (block.cell(), block.material.as_deref().unwrap_or_default()));
    faults.is_empty().then(|| RawRecord {
        run_idx: line.run_idx,
        turn_idx: line.turn_idx,
        n_turns: line.n_turns,
        prompt: line.prompt.unwrap_or_default(),
        checks,
        structure: Structure::from_named(blocks),
        builder_model: line.builder_model,
        line: number,
    })
}

impl Block {
    const fn cell(&self) -> Cell {
        Cell::new(self.x.0, self.y.0, self.z.0)
    }
}

/// Assembles records into problems, in the order of their numbers.
///
/// # Errors
/// Returns faults if a turn is recorded twice or is missing, or lines disagree on the number of turns of a problem.
pub fn problems(records: Vec<RawRecord>) -> Result<Vec<RecordedProblem>, Vec<Fault>> {
    let mut faults = Faults::new();
    let mut by_number: BTreeMap<u32, BTreeMap<u32, RawRecord>> = BTreeMap::new();
    for record in records {
        let turns = by_number.entry(record.run_idx).or_default();
        faults.enter_line(record.line);
        if let Some(earlier) = turns.get(&record.turn_idx) {
            let (run, turn) = (record.run_idx, record.turn_idx);
            faults.add(format!("turn {turn} of problem {run} was already given in line {}", earlier.line));
            continue;
        }
        if turns.values().any(|earlier| earlier.n_turns != record.n_turns) {
            faults.add(format!("problem {} has a different n_turns in an earlier line", record.run_idx));
        }
        turns.insert(record.turn_idx, record);
    }
    let mut problems = Vec::with_capacity(by_number.len());
    for (number, turns) in by_number {
        let (Some(first), Some(last)) = (turns.values().next(), turns.values().next_back()) else { continue };
        if turns.len() as u64 != u64::from(first.n_turns) {
            faults.enter_line(last.line);
            faults.add(format!("problem {number} has {} of its {} turns", turns.len(), first.n_turns));
            continue;
        }
        let mut task = Task::foreign(format!("recorded/{number}"), number, Vec::new());
        let mut structures = Vec::new();
        for record in turns.into_values() {
            task.turns.push(Instruction::new(record.prompt, record.checks));
            structures.push(record.structure);
        }
        problems.push(RecordedProblem { task, structures });
    }
    if faults.is_empty() { Ok(problems) } else { Err(faults.into_list()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_faulty_line_is_named() {
        let text = "{\"run_idx\":1,\"turn_idx\":1,\"n_turns\":1,\"checks\":[],\"coords\":[{\"x\":1.5,\"y\":0,\"z\":0}]}\n\nnonsense\n";
        let faults = read_records(text).unwrap_err();
        let lines: Vec<_> = faults.iter().map(|fault| fault.line).collect();
        assert_eq!(lines, [Some(1), Some(3)]);
        assert!(faults[0].detail.contains("coords[0].x"), "{}", faults[0].detail);
    }

    #[test]
    fn a_document_over_several_lines_is_one_fault() {
        for text in ["\n{\n  \"run_idx\": 1\n}\n", "[\n  {\"run_idx\": 1}\n]"] {
            let [fault] = read_records(text).unwrap_err().try_into().unwrap();
            let Fault { line, detail, .. } = fault;
            assert!(line == Some(1 + u64::from(text.starts_with('\n'))) && detail.contains("jq -c"), "{detail}");
        }
    }

    #[test]
    fn a_missing_turn_is_a_fault() {
        let line = r#"{"run_idx":7,"turn_idx":2,"n_turns":2,"checks":[],"coords":[]}"#;
        let faults = problems(read_records(line).unwrap()).unwrap_err();
        assert_eq!(faults[0].detail, "problem 7 has 1 of its 2 turns");
    }
}
