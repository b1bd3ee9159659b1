//! Iterations, time and memory of the equilibrium by finite elements for structures that are hard for it:
//! `equilibrium [NAME]`.
//!
//! Prints the median of three solutions of each structure. The memory is the most that the process has held so far, so
//! name one structure to see its own.

#![allow(clippy::print_stdout, reason = "it prints what it measured")]

use std::time::Instant;

use anyhow::Context as _;
use plumbline_engine::elasticity::{Control, fem};
use plumbline_engine::voxel::Cell;

/// A name, and what makes the blocks.
type Structure = (&'static str, fn() -> Vec<Cell>);

/// Number of solutions of each structure.
const ROUNDS: usize = 3;

fn cuboid(x: i32, y: i32, z: i32) -> Vec<Cell> {
    (0..x * y * z).map(|i| Cell::new(i % x, i / x % y, i / x / y)).collect()
}

/// Returns a cube of which each block is there with a probability of `permille` in a thousand.
fn sponge(side: i32, permille: u64) -> Vec<Cell> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut is_there = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % 1_000 < permille
    };
    cuboid(side, side, side).into_iter().filter(|_| is_there()).collect()
}

/// Returns a square roof one block thick on columns that are 20 blocks apart.
fn roof(side: i32) -> Vec<Cell> {
    cuboid(side, 4, side).into_iter().filter(|c| c.y == 3 || c.x % 20 == 0 && c.z % 20 == 0).collect()
}

fn main() -> anyhow::Result<()> {
    let name = std::env::args().nth(1);
    let structures: [Structure; 12] = [
        ("cube-10", || cuboid(10, 10, 10)),
        ("cube-22", || cuboid(22, 22, 22)),
        ("cube-37", || cuboid(37, 37, 37)),
        ("cube-46", || cuboid(46, 46, 46)),
        ("wall-300", || cuboid(300, 300, 1)),
        ("tower-5000", || cuboid(3, 5_000, 3)),
        ("roof-300", || roof(300)),
        ("sponge-30-0.5", || sponge(30, 500)),
        ("sponge-32-0.4", || sponge(32, 400)),
        ("sponge-40-0.33", || sponge(40, 330)),
        ("sponge-59-0.5", || sponge(59, 500)),
        ("sponge-70-0.33", || sponge(70, 330)),
    ];
    if let Some(name) = &name {
        let known = structures.map(|(known, _)| known);
        anyhow::ensure!(known.contains(&name.as_str()), "no structure {name}; there are {}", known.join(", "));
    }
    println!("structure        blocks  supported  iterations  residual        ms  MiB");
    for (structure, cells) in structures {
        if name.as_ref().is_some_and(|name| name != structure) {
            continue;
        }
        let cells = cells();
        let mut times = Vec::new();
        let mut solved = None;
        for _ in 0..ROUNDS {
            let start = Instant::now();
            solved = Some(fem::solve_equilibrium(&cells, &Control::unhurried())?);
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let solved = solved.context("no round ran")?;
        println!(
            "{:14} {:8} {:10} {:11} {:9.1e} {:9.1} {:4}{}",
            structure,
            cells.len(),
            cells.len() - solved.unsupported.len(),
            solved.iterations,
            solved.relative_residual,
            times[ROUNDS / 2],
            peak_mib()?,
            if solved.is_solved { "" } else { "  not solved" },
        );
    }
    Ok(())
}

/// Returns the most memory that this process has held.
fn peak_mib() -> anyhow::Result<u64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM")?;
    let kib: u64 = peak.split_whitespace().next().context("no number")?.parse()?;
    Ok(kib >> 10)
}
