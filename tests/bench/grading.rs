//! Benchmarks of grading: `cargo bench`. Figures and how they were obtained are in README.md beside this file.

#![allow(clippy::panic, reason = "a benchmark without its input cannot go on")]

use divan::Bencher;
use divan::counter::ItemsCount;
use plumbline::builders::build;
use plumbline::checks::{Check, Subject};
use plumbline::elasticity::{Control, sph};
use plumbline::grading::grade_log;
use plumbline::tasks::{Task, embedded};
use plumbline::voxel::replay::Replay;
use plumbline::voxel::{Cell, Structure};

fn main() {
    divan::main();
}

fn task(id: &str) -> Task {
    let suite = embedded::full().unwrap_or_else(|faults| panic!("{faults:?}"));
    suite.tasks.into_iter().find(|task| task.id == id).unwrap_or_else(|| panic!("no task {id}"))
}

/// A log graded against its task, without a stress simulation: replay, checks, report.
#[divan::bench(args = ["1-se-2-walls/12-w1", "2-bt-3-multi_beds/05-w1", "3-ae-5.2-accessibility_theater/03-w1", "1-se-4-frames/09-w1"])]
fn grade(bencher: Bencher<'_, '_>, id: &str) {
    let task = task(id);
    let log = build(&task).unwrap_or_default();
    bencher.counter(ItemsCount::new(1usize)).bench(|| grade_log(&task, &log, &Control::unhurried()));
}

/// The published stress simulation: the roof of 140 blocks, and cubes.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn stress_roof_140(bencher: Bencher<'_, '_>) {
    let task = task("1-se-3.2-roofs_cols-one_layer-stress/01-w1");
    let log = build(&task).unwrap_or_default();
    let structure = Replay::new(&log).last();
    let cells = structure.as_ref().map(Structure::cells).unwrap_or_default();
    bencher.bench(|| sph::simulate(cells, &Control::unhurried()));
}

#[divan::bench(args = [6, 10], sample_count = 3, sample_size = 1)]
fn stress_cube(bencher: Bencher<'_, '_>, side: i32) {
    let cells: Vec<Cell> =
        (0..side * side * side).map(|i| Cell::new(i % side, i / side % side, i / side / side)).collect();
    bencher.bench(|| sph::simulate(&cells, &Control::unhurried()));
}

/// A check at the limit of 100,000 blocks on one level, and the diameter of a disc of 9,000 cells.
#[divan::bench(args = [9_000, 100_000])]
fn diameter(bencher: Bencher<'_, '_>, cells: i32) {
    let side = f64::from(cells).sqrt().ceil() as i32;
    let structure = Structure::from_named((0..cells).map(|i| (Cell::new(i % side, 0, i / side), "stone")));
    let check: Check = serde_json::from_value(serde_json::json!({
        "fn": "shape.cluster_at_y_has_min_diameter", "args": { "y": 0, "min_diameter": 50 }
    }))
    .unwrap_or_else(|error| panic!("{error}"));
    bencher.bench(|| check.evaluate(&Subject::unhurried(&structure)));
}
