//! `plumbline tasks saboteurs`: the table of the criteria that each saboteur makes fail in each family.

use std::fmt::Write as _;

use super::{Report, grade_log};
use crate::builders::build;
use crate::builders::saboteurs::SABOTEURS;
use crate::checks::Criterion;
use crate::elasticity::Control;
use crate::tasks::{Suite, Task};
use crate::voxel::BlockLog;

/// Text of a cell if the saboteur finds nothing to spoil.
const UNCHANGED: &str = "=";
/// Text of a cell if the build is spoiled in a way that no criterion of the family detects.
const UNSEEN: &str = ".";

/// Makes the table in Markdown: a row per saboteur and a column per family of the suite, from the first task of each.
#[must_use]
pub fn markdown(suite: &Suite) -> String {
    let families: Vec<(&Task, BlockLog)> =
        suite.families().iter().filter_map(|tasks| Some((tasks.first()?, build(tasks.first()?).ok()?))).collect();
    let mut text = String::from("| saboteur |");
    // Writing to a string cannot fail.
    for number in 1..=families.len() {
        let _ = write!(text, " {number} |");
    }
    let _ = write!(text, "\n|---|{}\n", "---|".repeat(families.len()));
    for saboteur in SABOTEURS {
        let _ = write!(text, "| `{}` |", saboteur.name);
        for (task, good) in &families {
            let _ = write!(text, " {} |", cell(task, good, &saboteur.spoil(good.clone())));
        }
        text.push('\n');
    }
    text.push('\n');
    let named = (1..).zip(&families).map(|(number, (task, _))| format!("{number} {}", task.family()));
    let _ = writeln!(text, "Families: {}.", named.collect::<Vec<_>>().join(", "));
    text
}

fn cell(task: &Task, good: &BlockLog, spoiled: &BlockLog) -> String {
    if spoiled.canonical_json() == good.canonical_json() {
        return UNCHANGED.to_owned();
    }
    let report = |log: &BlockLog| grade_log(task, log, &Control::unhurried());
    let (Ok(before), Ok(after)) = (report(good), report(spoiled)) else { return "?".to_owned() };
    let fails = |report: &Report, criterion| report.criteria.iter().any(|c| c.criterion == criterion && !c.holds);
    let failed = Criterion::ALL.into_iter().filter(|c| fails(&after, *c) && !fails(&before, *c)).map(letter);
    let letters: String = failed.collect();
    if letters.is_empty() { UNSEEN.to_owned() } else { letters }
}

/// Returns the letter of a criterion.
const fn letter(criterion: Criterion) -> char {
    match criterion {
        Criterion::Material => 'M',
        Criterion::Shape => 'S',
        Criterion::Size => 'Z',
        Criterion::PhysicalPlausibility => 'P',
        Criterion::StructuralStability => 'T',
        Criterion::Efficiency => 'E',
        Criterion::Dependency => 'D',
    }
}
