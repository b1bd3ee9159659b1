//! Structural elements: foundations, walls, roofs on columns, frames.

use super::demands::Demands;
use super::site::Site;
use crate::voxel::Cell;

/// A slab in the ground, its top at y = -1.
pub fn foundation(site: &mut Site, demands: &Demands) {
    let [a, b] = demands.plan.unwrap_or([7, 7]);
    let depth = demands.height.unwrap_or(1);
    site.fill(&(0..=a - 1), &(-depth..=-1), &(0..=b - 1), "stone");
}

/// A cap whose top is at y = 0, on piles five deep.
pub fn deep_foundation(site: &mut Site, demands: &Demands) {
    const PILE_DEPTH: i32 = 5;
    let lowest = demands.lowest_y.unwrap_or(-PILE_DEPTH);
    let piles = demands.clusters.first().map_or(4, |(_, count)| *count);
    let thickness = -(PILE_DEPTH - 1) - lowest;
    let area = (demands.block_count.unwrap_or_default() - PILE_DEPTH * piles) / thickness.max(1);
    let (a, b) = [(7, 7), (7, 9), (9, 9)].into_iter().find(|(a, b)| a * b == area).unwrap_or((7, 7));
    let places = [(1, 1), (a - 2, b - 2), (1, b - 2), (a - 2, 1), (a / 2, b / 2), (a / 2, 1)];
    for (x, z) in places.into_iter().take(piles.max(0) as usize) {
        site.fill(&(x..=x), &(lowest..=lowest + PILE_DEPTH - 1), &(z..=z), "stone");
    }
    site.fill(&(0..=a - 1), &(lowest + PILE_DEPTH..=0), &(0..=b - 1), "stone");
}

/// A wall on the ground.
pub fn wall(site: &mut Site, demands: &Demands) {
    let [thickness, width] = demands.plan.unwrap_or([1, 5]);
    let height = demands.height.unwrap_or(5);
    site.fill(&(0..=thickness - 1), &(0..=height - 1), &(0..=width - 1), "stone");
}

/// A flat roof of one layer on columns one block thick.
pub fn roof_on_columns(site: &mut Site, demands: &Demands) {
    let columns = demands.clusters.first().map_or(4, |(_, count)| *count);
    let blocks = demands.least_blocks.unwrap_or(21);
    let sizes = [(3, 5), (5, 5), (5, 7), (7, 7)].into_iter();
    // Roof and height are those whose blocks add up to the count.
    let fits = sizes.flat_map(|(a, b)| [3, 4].map(|h| (a, b, h))).find(|(a, b, h)| a * b + columns * h == blocks);
    let (a, b, height) = fits.unwrap_or((7, 7, 4));
    let places = [(0, 0), (a - 1, b - 1), (0, b - 1), (a - 1, 0), (a / 2, b / 2)];
    for (x, z) in places.into_iter().take(columns.max(0) as usize) {
        site.fill(&(x..=x), &(0..=height - 1), &(z..=z), demands.material(0));
    }
    site.fill(&(0..=a - 1), &(height..=height), &(0..=b - 1), demands.material(1));
}

/// A roof of ten by ten on balanced columns of two by two by two: the reference structures of SPEC 4.
pub fn roof_under_stress(site: &mut Site, demands: &Demands) {
    let columns = demands.clusters.first().map_or(4, |(_, count)| *count);
    let places = [(1, 1), (1, 7), (7, 7), (7, 1), (4, 4)];
    for (x, z) in places.into_iter().take(columns.max(0) as usize) {
        site.fill(&(x..=x + 1), &(0..=1), &(z..=z + 1), demands.material(0));
    }
    let layers = (demands.least_blocks.unwrap_or(100) - 8 * columns) / 100;
    for layer in 1..=layers {
        site.fill(&(0..=9), &(layer + 1..=layer + 1), &(0..=9), demands.material(layer as usize));
    }
}

const CONCRETE: &str = "white_concrete";

/// Four columns, beams at every floor, and stairs that wind up inside.
pub fn frame(site: &mut Site, demands: &Demands) {
    let top = demands.highest_y.unwrap_or(8);
    let last = 8;
    for (x, z) in [(0, 0), (last, 0), (last, last), (0, last)] {
        site.fill(&(x..=x), &(0..=top), &(z..=z), CONCRETE);
    }
    for floor in (4..=top).step_by(4) {
        site.ring(&(0..=last), &(floor..=floor), &(0..=last), CONCRETE, &|_| false);
    }
    winding_stairs(site, demands.stairs_to_y.unwrap_or(4));
}

/// Stairs round a square of five by five, each step on a block of its own, up to `top`.
fn winding_stairs(site: &mut Site, top: i32) {
    let side = |from: (i32, i32), step: (i32, i32)| (0..4).map(move |i| (from.0 + i * step.0, from.1 + i * step.1));
    let round: Vec<(i32, i32)> = side((2, 2), (1, 0))
        .chain(side((6, 2), (0, 1)))
        .chain(side((6, 6), (-1, 0)))
        .chain(side((2, 6), (0, -1)))
        .collect();
    for (y, (x, z)) in (0..=top).zip(round.into_iter().cycle()) {
        if y > 0 {
            site.place(Cell::new(x, y - 1, z), CONCRETE);
        }
        site.place(Cell::new(x, y, z), CONCRETE);
    }
}

/// Four columns and the slab of a second floor at y = 5.
pub fn second_floor(site: &mut Site, _demands: &Demands) {
    for (x, z) in [(0, 0), (8, 0), (8, 8), (0, 8)] {
        site.fill(&(x..=x), &(0..=4), &(z..=z), CONCRETE);
    }
    site.fill(&(0..=8), &(5..=5), &(0..=8), CONCRETE);
}
