//! Builds as a few strokes, each a lattice of cells or cells at random: small to write down, and easy to change.

use std::collections::HashSet;

use plumbline_engine::voxel::{Cell, Structure};
use rand_mt::Mt64;
use serde::{Deserialize, Serialize};

/// Names of blocks that checks treat in different ways.
pub const MATERIALS: [&str; 8] =
    ["stone", "glass", "oak_door", "red_bed", "oak_stairs", "torch", "oak_planks", "stone_bricks"];
/// A part of a build.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stroke {
    /// The cells from `from` on, by `counts` steps in each of three directions.
    Lattice { from: [i32; 3], steps: [[i32; 3]; 3], counts: [u32; 3], material: usize },
    /// So many cells anywhere in a box.
    Scatter { from: [i32; 3], size: [u32; 3], count: u32, seed: u64, material: usize },
}

impl Stroke {
    /// Gives each of its cells to `put`, until that refuses.
    fn draw(&self, mut put: impl FnMut(Cell, usize) -> bool) {
        match self {
            Self::Lattice { from, steps, counts, material } => {
                let at = |i: [u32; 3]| {
                    let along = |axis: usize| (0..3).map(|n| i[n] as i32 * steps[n][axis]).sum::<i32>() + from[axis];
                    Cell::new(along(0), along(1), along(2))
                };
                let all = (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j)));
                let mut all = all.flat_map(|(i, j)| (0..counts[2]).map(move |k| [i, j, k]));
                let _ = all.all(|i| put(at(i), *material));
            }
            Self::Scatter { from, size, count, seed, material } => {
                let mut random = Mt64::new(*seed);
                let mut along = |axis: usize| from[axis] + (random.next_u64() % u64::from(size[axis].max(1))) as i32;
                let _ = (0..*count).all(|_| put(Cell::new(along(0), along(1), along(2)), *material));
            }
        }
    }
}

/// Returns the build of strokes, of at most so many blocks. Where two meet, the first stays.
pub fn structure(strokes: &[Stroke], most: usize) -> Structure {
    let (mut taken, mut blocks) = (HashSet::new(), Vec::new());
    for stroke in strokes {
        if blocks.len() >= most {
            break;
        }
        let mut tries = 0;
        stroke.draw(|cell, material| {
            tries += 1;
            if cell.in_range() && taken.insert(cell) {
                blocks.push((cell, MATERIALS[material % MATERIALS.len()]));
            }
            blocks.len() < most && tries < 2 * most
        });
    }
    Structure::from_named(blocks)
}
