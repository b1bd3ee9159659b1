//! How long each check takes at most, on builds that are made to be hard for it: `worst_checks [BLOCKS]`.
//!
//! The figures stand in `engine/src/grading/cost.rs`, which decides by them where a log is graded. Prints, for each check,
//! the slowest build and the nanoseconds per block, and the most nanoseconds per cell of the space around a build, as the
//! least of five rounds.

#![allow(clippy::print_stdout, reason = "it prints what it measured")]

mod arguments;

use std::time::Instant;

use anyhow::Context as _;
use arguments::arguments;
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::voxel::terrain::MAX_EXTENT;
use plumbline_engine::voxel::{Cell, Structure};
use serde_json::json;

const MATERIALS: [&str; 5] = ["stone", "glass", "oak_door", "red_bed", "oak_stairs"];

/// Builds of so many blocks: solid, flat, thin, scattered near and far, in walls, in towers, in checks.
fn builds(count: i32) -> Vec<(&'static str, Vec<Cell>)> {
    let side = f64::from(count).cbrt().ceil() as i32;
    let plane = f64::from(count).sqrt().ceil() as i32;
    let mut state = 7_u64;
    let mut random = move |n: i32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % n.max(1) as u64) as i32
    };
    let mut scattered = |x: i32, y: i32, z: i32| -> Vec<Cell> {
        (0..count).map(|_| Cell::new(random(x), random(y), random(z))).collect()
    };
    let cells = |cell: &dyn Fn(i32) -> Cell| (0..count).map(cell).collect::<Vec<_>>();
    vec![
        ("cube", cells(&|i| Cell::new(i % side, i / side / side, i / side % side))),
        ("plane", cells(&|i| Cell::new(i % plane, 0, i / plane))),
        ("wall", cells(&|i| Cell::new(i % plane, i / plane, 0))),
        ("line", cells(&|i| Cell::new(i, 0, 0))),
        ("diagonal", cells(&|i| Cell::new(i, 0, i))),
        ("stairs", cells(&|i| Cell::new(i % 300, i % 300, i / 300))),
        ("tower", cells(&|i| Cell::new(i / 300, i % 300, 0))),
        ("checkered plane", cells(&|i| Cell::new(2 * (i % plane) + i / plane % 2, 0, i / plane))),
        (
            "checkered cube",
            cells(&|i| Cell::new(2 * (i % side) + (i / side + i / side / side) % 2, i / side / side, i / side % side)),
        ),
        ("dotted plane", cells(&|i| Cell::new(3 * (i % plane), 0, 3 * (i / plane)))),
        (
            "rings",
            cells(&|i| {
                let r = 1 + (i / 8) % 60;
                let k = i % 8;
                Cell::new([-r, -r, -r, 0, 0, r, r, r][k as usize], i / 480, [-r, 0, r, -r, r, -r, 0, r][k as usize])
            }),
        ),
        ("scattered 20", scattered(20, 20, 20)),
        ("scattered 60", scattered(60, 60, 60)),
        ("scattered 120", scattered(120, 120, 120)),
        ("scattered plane", scattered(120, 1, 120)),
        ("scattered 1000", scattered(1_000, 300, 1_000)),
        ("scattered far", scattered(10_000_000, 300, 10_000_000)),
        ("scattered far plane", scattered(10_000_000, 1, 10_000_000)),
    ]
}

/// Cells of the space around a build, as the estimate counts them.
fn space_around(structure: &Structure) -> f64 {
    let Some(bounds) = structure.bounds() else { return 1.0 };
    let [x, _, z] = bounds.extent();
    [x, i64::from(bounds.max.y.max(0)), z].iter().map(|extent| (*extent.min(&MAX_EXTENT) + 5) as f64).product()
}

fn main() -> anyhow::Result<()> {
    let count = std::env::args().nth(1).and_then(|count| count.parse().ok()).unwrap_or(1_000);
    for (name, _) in Check::LIST {
        let check: Check = serde_json::from_value(json!({ "fn": name, "args": arguments(name) }))
            .with_context(|| format!("{name}: arguments.rs has no arguments for it"))?;
        let is_stress = name.starts_with("structural_stability");
        let mut worst = (0, String::new());
        let mut by_space = (0.0, "");
        for (build, cells) in builds(count) {
            for mixed in [false, true] {
                let material = |i: usize| if mixed { MATERIALS[i % MATERIALS.len()] } else { "stone" };
                let structure = Structure::from_named(cells.iter().enumerate().map(|(i, cell)| (*cell, material(i))));
                if is_stress && (mixed || build.starts_with("scattered")) {
                    continue;
                }
                let least = (0..if is_stress { 1 } else { 5 }).map(|_| {
                    let begun = Instant::now();
                    let _ = std::hint::black_box(check.evaluate(&Subject::unhurried(&structure)));
                    begun.elapsed().as_nanos()
                });
                let took = least.min().unwrap_or_default();
                let by_cell = took as f64 / space_around(&structure);
                if by_cell > by_space.0 {
                    by_space = (by_cell, build);
                }
                if took > worst.0 {
                    worst = (took, format!("{build}{}", if mixed { ", mixed" } else { "" }));
                }
            }
        }
        let (micros, by_block) = (worst.0 / 1_000, worst.0 / count as u128);
        println!(
            "{name:50} {micros:>9} us  {by_block:>8} ns/block  {}; {:.1} ns/cell {}",
            worst.1, by_space.0, by_space.1
        );
    }
    Ok(())
}
