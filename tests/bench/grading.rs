//! Benchmarks of grading: `cargo bench`. Figures and how they were obtained are in README.md beside this file.

#![allow(clippy::panic, reason = "a benchmark without its input cannot go on")]
#![allow(clippy::inline_always, reason = "so that the peak is compiled for the processor it runs on")]

use divan::Bencher;
use divan::counter::ItemsCount;
use plumbline_engine::builders::build;
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::elasticity::{Control, fem, sph};
use plumbline_engine::grading::grade_log;
use plumbline_engine::hidden::tlog::tiles::{TILE, TileName};
use plumbline_engine::hidden::tlog::tree::{Tree, leaf};
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{Cell, Structure};

fn main() {
    divan::main();
}

fn task(id: &str) -> Task {
    let suite = embedded::latest().unwrap_or_else(|faults| panic!("{faults:?}"));
    suite.tasks.into_iter().find(|task| task.id == id).unwrap_or_else(|| panic!("no task {id}"))
}

/// A log graded against its task, without a stress simulation: replay, checks, report.
#[divan::bench(args = ["walls/10x2x7-raise", "bedrooms/r5-build", "theatres/s35-build", "frames/s10-frame-build"])]
fn grade(bencher: Bencher<'_, '_>, id: &str) {
    let task = task(id);
    let log = build(&task).unwrap_or_default();
    bencher.counter(ItemsCount::new(1usize)).bench(|| grade_log(&task, &log, &Control::unhurried()));
}

/// The transparency log with a million entries.
fn log_of_a_million() -> Tree {
    let mut tree = Tree::default();
    (0..1_000_000_u32).for_each(|i| tree.push(leaf(&i.to_be_bytes())));
    tree
}

/// A proof that an entry is in the log, and that the log began with half of it; the root is computed for the
/// checkpoint.
#[divan::bench]
fn proofs_in_a_log_of_a_million(bencher: Bencher<'_, '_>) {
    let tree = log_of_a_million();
    let size = tree.len() - 1;
    bencher.bench(|| (tree.inclusion(123_456, size), tree.consistency(size / 2, size), tree.root(size)));
}

/// A tile of hashes of the log.
#[divan::bench]
fn tile_of_a_log_of_a_million(bencher: Bencher<'_, '_>) {
    let tree = log_of_a_million();
    let tile = TileName { level: Some(0), index: 1_000, width: TILE };
    bencher.bench(|| tile.hashes(&tree));
}

fn roof() -> Vec<Cell> {
    let log = build(&task("one-layer-roofs/c5-span")).unwrap_or_default();
    Replay::new(&log).last().as_ref().map(Structure::cells).unwrap_or_default().to_vec()
}

fn cube(side: i32) -> Vec<Cell> {
    (0..side * side * side).map(|i| Cell::new(i % side, i / side % side, i / side / side)).collect()
}

/// The published stress simulation on one core: the roof of 140 blocks, and cubes.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn sph_roof_140(bencher: Bencher<'_, '_>) {
    let cells = roof();
    bencher.bench(|| sph::simulate(&cells, &Control::unhurried()));
}

#[divan::bench(args = [6, 10, 22, 37], sample_count = 3, sample_size = 1)]
fn sph_cube(bencher: Bencher<'_, '_>, side: i32) {
    let cells = cube(side);
    bencher.counter(ItemsCount::new(cells.len())).bench(|| sph::simulate(&cells, &Control::unhurried()));
}

/// The same on all cores.
#[divan::bench(args = [22, 37], sample_count = 3, sample_size = 1)]
fn sph_cube_all_cores(bencher: Bencher<'_, '_>, side: i32) {
    let cells = cube(side);
    let join = |a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)| {
        rayon::join(a, b);
    };
    let control = Control { join: Some(&join), ..Control::unhurried() };
    bencher.counter(ItemsCount::new(cells.len())).bench(|| sph::simulate(&cells, &control));
}

/// Equilibrium by finite elements on one core: the roof, and cubes of about 1,000, 10,000 and 50,000 blocks.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn fem_roof_140(bencher: Bencher<'_, '_>) {
    let cells = roof();
    bencher.bench(|| fem::solve_equilibrium(&cells, &Control::unhurried()));
}

#[divan::bench(args = [10, 22, 37], sample_count = 3, sample_size = 1)]
fn fem_cube(bencher: Bencher<'_, '_>, side: i32) {
    let cells = cube(side);
    bencher.counter(ItemsCount::new(cells.len())).bench(|| fem::solve_equilibrium(&cells, &Control::unhurried()));
}

/// What one core can do: independent multiply-adds in registers, in vectors as wide as it has.
#[divan::bench]
fn multiply_add_peak(bencher: Bencher<'_, '_>) {
    const ROUNDS: usize = 10_000;
    const CHAINS: usize = 16;
    struct Peak;
    impl pulp::WithSimd for Peak {
        type Output = f64;
        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
            let (factor, term) = (simd.splat_f64s(0.999_999), simd.splat_f64s(1e-9));
            let mut sums = [simd.splat_f64s(1.0); CHAINS];
            for _ in 0..ROUNDS * 8 / S::F64_LANES {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f64s(*sum, factor, term);
                }
            }
            sums.into_iter().map(|sum| simd.reduce_sum_f64s(sum)).sum()
        }
    }
    let arch = pulp::Arch::new();
    bencher.counter(ItemsCount::new(ROUNDS * CHAINS * 8)).bench(|| arch.dispatch(Peak));
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
