//! Difficulty of hidden families beside the public ones that they stand for, by the pass rates of a panel: a good
//! builder whom each saboteur spoils, and three agents of graded carelessness.
//!
//! `cargo test --package plumbline-engine --test engine panel:: -- --nocapture` prints the table in `tasks/README.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use plumbline_engine::builders::build;
use plumbline_engine::builders::saboteurs::SABOTEURS;
use plumbline_engine::checks::Criterion;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_log;
use plumbline_engine::hidden::pool::{Generator, Stratum};
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::{BlockLog, Event};
use rand_mt::Mt64;
use rayon::prelude::*;

use crate::repository;

/// Instances of each family.
const INSTANCES: usize = 12;
/// Blocks of which a careless agent misplaces or forgets one.
const BLOCKS_PER_SLIP: [u64; 3] = [400, 100, 25];
/// Greatest difference of the panel's pass rates.
const MAX_APART: f64 = 0.15;

/// The log of an agent who forgets some blocks, and puts some beside where they belong.
fn careless(mut log: BlockLog, blocks_per_slip: u64, seed: u64) -> BlockLog {
    let mut random = Mt64::new(seed);
    for turn in &mut log.turns {
        turn.retain_mut(|event| {
            let slips = random.next_u64().is_multiple_of(blocks_per_slip);
            let is_forgotten = random.next_u64().is_multiple_of(2);
            if let Event::Place { cell, .. } = event
                && slips
            {
                *cell = cell.offset(0, 1, 0);
                return !is_forgotten;
            }
            true
        });
    }
    log
}

/// Pass rates on a task: of the spoiled builds together, and of each careless agent.
fn rates(task: &Task) -> [f64; 4] {
    let mut task = task.clone();
    for turn in &mut task.turns {
        turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
    }
    let good = build(&task).unwrap();
    let passes = |log: &BlockLog| f64::from(u8::from(grade_log(&task, log, &Control::unhurried()).unwrap().overall));
    let spoiled: f64 = SABOTEURS.iter().map(|saboteur| passes(&saboteur.spoil(good.clone()))).sum();
    let careless = BLOCKS_PER_SLIP.map(|blocks| {
        let attempts = 8;
        (0..attempts).map(|seed| passes(&careless(good.clone(), blocks, seed))).sum::<f64>() / attempts as f64
    });
    [spoiled / SABOTEURS.len() as f64, careless[0], careless[1], careless[2]]
}

fn mean(tasks: &[Task]) -> [f64; 4] {
    let all: Vec<[f64; 4]> = tasks.par_iter().map(rates).collect();
    [0, 1, 2, 3].map(|i| all.iter().map(|rates| rates[i]).sum::<f64>() / all.len() as f64)
}

/// Tasks of a family that differ in more than their wording, spread over the family.
fn spread(tasks: &[Task]) -> Vec<Task> {
    let instances: Vec<&[Task]> = tasks.chunk_by(|a, b| a.parameters == b.parameters).collect();
    let step = instances.len().div_ceil(INSTANCES);
    instances.into_iter().step_by(step.max(1)).map(|tasks| tasks[0].clone()).collect()
}

#[test]
fn hidden_families_are_as_hard_for_a_panel_as_public_ones() {
    let public = embedded::latest().unwrap();
    let of_public: BTreeMap<&str, Vec<Task>> =
        public.families().into_iter().map(|tasks| (tasks[0].family(), spread(tasks))).collect();
    let generator = Generator::new().unwrap();
    let key = EpochKey::new([6; 32]);
    let mut table = String::from("| family | spoiled | one slip in 400 | in 100 | in 25 |\n|---|---|---|---|---|\n");
    let mut apart = Vec::new();
    for family in generator.families() {
        let stands_for = &family.content.draw.as_ref().unwrap().stands_for;
        if stands_for.is_empty() {
            continue;
        }
        let stratum = Stratum { family: family.name().to_owned(), instances: 1, first: 0, size: INSTANCES as u32 };
        let made = generator.specifications(&key, &stratum, &|| ()).unwrap();
        let hidden = mean(&made.into_iter().map(|own| own.task).collect::<Vec<_>>());
        let tasks: Vec<Task> = stands_for.iter().flat_map(|name| of_public[name.as_str()].clone()).collect();
        let public = mean(&tasks);
        let cells = [0, 1, 2, 3].map(|i| format!("{:.0} %, {:.0} %", 100.0 * hidden[i], 100.0 * public[i]));
        let _ = writeln!(table, "| {} | {} |", family.name(), cells.join(" | "));
        let panel = |rates: [f64; 4]| f64::midpoint(rates[0], rates[1..].iter().sum::<f64>() / 3.0);
        if (panel(hidden) - panel(public)).abs() > MAX_APART {
            apart.push(format!("{}: {:.2} and {:.2}", family.name(), panel(hidden), panel(public)));
        }
    }
    println!("{table}");
    assert!(apart.is_empty(), "{apart:#?}");
    let readme = std::fs::read_to_string(repository("tasks/README.md")).unwrap();
    assert!(readme.contains(&table), "put this table into tasks/README.md:\n{table}");
}
