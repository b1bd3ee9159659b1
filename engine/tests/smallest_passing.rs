//! A search for degenerate builds that pass: for each family the smallest build found that still passes a task, beside
//! the good one. Starts are the good build, its smaller siblings, and random cheap shapes; from what passes, blocks are
//! left out while it still passes.
//!
//! `cargo test --package plumbline-engine --test engine smallest_passing:: -- --nocapture` prints the table in `tasks/README.md`.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use plumbline_engine::builders::{build, build_instance};
use plumbline_engine::checks::Criterion;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_log;
use plumbline_engine::hidden::pool::{Generator, Stratum};
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::{BlockLog, Cell, Event};
use rand_mt::Mt64;
use rayon::prelude::*;
use serde_json::json;

use crate::repository;

/// Random shapes tried for each task.
const SHAPES: usize = 300;
/// Random orders in which single blocks are left out.
const ORDERS: u64 = 2;
/// Share of the good build's blocks under which a passing build needs a reason.
const LEAST_SHARE: f64 = 0.5;

/// Families in which a passing build may be smaller, with the reason.
const REASONS: &[(&str, &str)] = &[
    (
        "asymmetric-buildings",
        "rooms of three by three cells, the least that is asked for, where the good build has four by four",
    ),
    ("cottages", "head room of two cells, the least that is asked for, where the good build may have four"),
];

/// A task without its simulations, which take long and count for no verdict.
fn without_simulations(task: &Task) -> Task {
    let mut task = task.clone();
    for turn in &mut task.turns {
        turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
    }
    task
}

fn passes(task: &Task, log: &BlockLog) -> bool {
    grade_log(task, log, &Control::unhurried()).unwrap().overall
}

/// Number of placements.
fn size(log: &BlockLog) -> usize {
    log.turns.iter().flatten().filter(|event| matches!(event, Event::Place { .. })).count()
}

fn without(log: &BlockLog, is_left_out: impl Fn(usize, Cell) -> bool) -> BlockLog {
    let mut log = log.clone();
    let mut number = 0;
    for turn in &mut log.turns {
        turn.retain(|event| {
            number += 1;
            matches!(event, Event::Remove { .. }) || !is_left_out(number - 1, event.cell())
        });
    }
    log
}

fn placed(log: &BlockLog) -> Vec<Cell> {
    let place = |event: &Event| matches!(event, Event::Place { .. }).then(|| event.cell());
    log.turns.iter().flatten().filter_map(place).collect()
}

fn shuffled<T>(mut items: Vec<T>, random: &mut Mt64) -> Vec<T> {
    for i in (1..items.len()).rev() {
        items.swap(i, (random.next_u64() % (i as u64 + 1)) as usize);
    }
    items
}

/// Leaves out levels, slices and columns, then single blocks, as long as the task is passed.
fn pared(task: &Task, log: BlockLog, seed: u64) -> BlockLog {
    let mut random = Mt64::new(seed);
    let mut log = log;
    let groups: [fn(Cell) -> [i32; 4]; 6] = [
        |c| [0, c.y, 0, 0],
        |c| [1, c.x, 0, 0],
        |c| [2, c.z, 0, 0],
        |c| [3, c.x, c.z, 0],
        |c| [4, c.x, c.y, 0],
        |c| [5, c.y, c.z, 0],
    ];
    for group in groups {
        let keys: BTreeSet<[i32; 4]> = placed(&log).into_iter().map(group).collect();
        for key in shuffled(keys.into_iter().collect(), &mut random) {
            let fewer = without(&log, |_, cell| group(cell) == key);
            if size(&fewer) < size(&log) && passes(task, &fewer) {
                log = fewer;
            }
        }
    }
    for cell in shuffled(placed(&log), &mut random) {
        let fewer = without(&log, |_, other| other == cell);
        if size(&fewer) < size(&log) && passes(task, &fewer) {
            log = fewer;
        }
    }
    log
}

/// Builds of the same family with one or two smaller numbers among their parameters.
fn siblings(task: &Task) -> Vec<BlockLog> {
    let numbers: Vec<(&String, i64)> =
        task.parameters.iter().filter_map(|(name, value)| Some((name, value.as_i64()?))).collect();
    let mut made = Vec::new();
    let mut add = |changes: &[(&String, i64)]| {
        let mut parameters = task.parameters.clone();
        parameters.extend(changes.iter().map(|(name, value)| ((*name).clone(), json!(value))));
        made.extend(build_instance(task.family(), &parameters, task.turns.len()));
    };
    for (i, (name, value)) in numbers.iter().enumerate() {
        for less in 1..=3 {
            add(&[(name, value - less)]);
            for (other, second) in &numbers[i + 1..] {
                add(&[(name, value - less), (other, second - less)]);
            }
        }
    }
    made
}

/// Houses of all sizes from three by three blocks on, in the materials of the task.
fn huts(task: &Task, good: &BlockLog) -> Vec<BlockLog> {
    let rooms = task.parameters.get("rooms").or(task.parameters.get("n")).and_then(serde_json::Value::as_i64);
    let beds = task.parameters.get("beds").or(task.parameters.get("n")).cloned().unwrap_or_else(|| json!(0));
    let mut made = Vec::new();
    let named = |i: usize| good.palette.names().nth(i).unwrap_or("stone").to_owned();
    for (pitch, depth, height) in
        (3..6).flat_map(|pitch| (3..6).flat_map(move |depth| (2..4).map(move |height| (pitch, depth, height))))
    {
        for order in 0..good.palette.len().clamp(1, 4) {
            let parameters = json!({
                "rooms": rooms.unwrap_or(1).max(1), "beds": beds, "pitch": pitch, "depth": depth, "height": height,
                "pillars": named(order), "walls": named(order + 1), "roof": named(order + 2),
            });
            made.extend(build_instance("dwellings", parameters.as_object().unwrap(), task.turns.len()));
        }
    }
    made
}

/// One to three boxes, solid or hollow, of materials of the good build, in and around its bounds.
fn random_shape(task: &Task, good: &BlockLog, random: &mut Mt64) -> BlockLog {
    let cells = placed(good);
    let (min, max) = cells.iter().fold((cells[0], cells[0]), |(a, b), c| {
        (Cell::new(a.x.min(c.x), a.y.min(c.y), a.z.min(c.z)), Cell::new(b.x.max(c.x), b.y.max(c.y), b.z.max(c.z)))
    });
    let mut within = |low: i32, high: i32| {
        let mut one = || low + (random.next_u64() % (i64::from(high) - i64::from(low) + 1) as u64) as i32;
        let (a, b) = (one(), one());
        (a.min(b), a.max(b))
    };
    let mut log = BlockLog::default();
    for _ in 0..=within(0, 2).0 {
        let (x, y, z) = (within(min.x, max.x), within(min.y, max.y), within(min.z, max.z));
        let is_hollow = within(0, 1).0 == 0;
        let material = good.palette.name(within(0, good.palette.len() as i32 - 1).0 as u32).to_owned();
        for (cx, cy, cz) in
            (x.0..=x.1).flat_map(|cx| (y.0..=y.1).flat_map(move |cy| (z.0..=z.1).map(move |cz| (cx, cy, cz))))
        {
            let is_inside = cx > x.0 && cx < x.1 && cy > y.0 && cy < y.1 && cz > z.0 && cz < z.1;
            if !(is_hollow && is_inside) {
                log.place(Cell::new(cx, cy, cz), &material);
            }
        }
    }
    log.turns.resize(task.turns.len(), Vec::new());
    log
}

/// Sizes of the good build of a task and of the smallest passing one that the search finds.
fn searched(task: &Task) -> (usize, usize) {
    let task = &without_simulations(task);
    let good = build(task).unwrap();
    assert!(passes(task, &good), "{}", task.id);
    let mut random = Mt64::new(11);
    let mut starts = vec![good.clone()];
    starts.extend(siblings(task).into_iter().chain(huts(task, &good)).filter(|log| passes(task, log)));
    starts.extend((0..SHAPES).map(|_| random_shape(task, &good, &mut random)).filter(|log| passes(task, log)));
    // The smallest starts lead to the smallest ends.
    starts.sort_by_key(size);
    starts.truncate(3);
    starts.push(good.clone());
    let ends = starts.iter().flat_map(|start| (0..ORDERS).map(|seed| size(&pared(task, start.clone(), seed))));
    (size(&good), ends.min().unwrap())
}

/// The middle task of each public family, and one hidden specification of each family.
fn tasks() -> Vec<(&'static str, Task)> {
    let public = embedded::latest().unwrap();
    let middle = |tasks: &[Task]| ("public", tasks[tasks.len() / 2].clone());
    let mut all: Vec<(&str, Task)> = public.families().into_iter().map(middle).collect();
    let generator = Generator::new().unwrap();
    let key = EpochKey::new([5; 32]);
    for family in generator.families() {
        let stratum = Stratum { family: family.name().to_owned(), instances: 1, first: 0, size: 1 };
        let made = generator.specifications(&key, &stratum, &|| ()).unwrap();
        all.extend(made.into_iter().map(|own| ("hidden", own.task)));
    }
    all
}

#[test]
fn no_small_build_passes() {
    let tasks = tasks();
    let sizes: Vec<(usize, usize)> = tasks.par_iter().map(|(_, task)| searched(task)).collect();
    let mut table =
        String::from("| family | suite | good build | smallest that passes | share |\n|---|---|---|---|---|\n");
    let mut small = Vec::new();
    for ((suite, task), (good, least)) in tasks.iter().zip(&sizes) {
        let share = *least as f64 / *good as f64;
        let _ = writeln!(table, "| {} | {suite} | {good} | {least} | {:.0} % |", task.family(), 100.0 * share);
        if share < LEAST_SHARE && REASONS.iter().all(|(family, _)| *family != task.family()) {
            small.push(format!("{}: {least} of {good}", task.id));
        }
    }
    println!("{table}");
    assert!(small.is_empty(), "{small:#?}");
    let readme = std::fs::read_to_string(repository("tasks/README.md")).unwrap();
    assert!(readme.contains(&table), "put this table into tasks/README.md:\n{table}");
}
