//! Structural elements: foundations, walls, roofs on columns, frames.

use serde::Deserialize;

use super::site::Site;
use crate::voxel::Cell;

/// Parameters of a slab: plan and depth, in blocks.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Slab {
    a: i32,
    b: i32,
    d: i32,
}

/// A slab in the ground, its top at y = -1.
pub fn foundation(site: &mut Site, slab: &Slab) {
    site.fill(&(0..=slab.a - 1), &(-slab.d..=-1), &(0..=slab.b - 1), "stone");
}

/// Parameters of a deep foundation: plan and thickness of the cap, number of piles.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct DeepFoundation {
    a: i32,
    b: i32,
    t: i32,
    p: usize,
}

/// A cap whose top is at y = 0, on piles five deep.
pub fn deep_foundation(site: &mut Site, foundation: &DeepFoundation) {
    const PILE_DEPTH: i32 = 5;
    let DeepFoundation { a, b, t, p } = *foundation;
    let lowest = 1 - t - PILE_DEPTH;
    let places = [(1, 1), (a / 2, 1), (a - 2, 1), (a - 2, b - 2), (a / 2, b - 2), (1, b - 2)];
    // Four stand in the corners, a fifth in the middle of a side, a sixth across from it.
    let order: &[usize] = if p == 4 { &[0, 2, 3, 5] } else { &[0, 1, 2, 3, 4, 5] };
    let order = if p == 5 { &[0, 1, 2, 3, 5] } else { order };
    for (x, z) in order.iter().filter_map(|&i| places.get(i)).copied() {
        site.fill(&(x..=x), &(lowest..=lowest + PILE_DEPTH - 1), &(z..=z), "stone");
    }
    site.fill(&(0..=a - 1), &(1 - t..=0), &(0..=b - 1), "stone");
}

/// Parameters of a wall: width, thickness and height, in blocks.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Wall {
    w: i32,
    t: i32,
    h: i32,
}

/// A wall on the ground.
pub fn wall(site: &mut Site, wall: &Wall) {
    site.fill(&(0..=wall.t - 1), &(0..=wall.h - 1), &(0..=wall.w - 1), "stone");
}

/// Parameters of a roof: plan, height of its columns and their number.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Roof {
    a: i32,
    b: i32,
    h: i32,
    n: usize,
}

/// A flat roof of one layer on columns one block thick.
pub fn roof_on_columns(site: &mut Site, roof: &Roof) {
    let Roof { a, b, h, n } = *roof;
    let places: &[(i32, i32)] = match n {
        2 => &[(0, 0), (a - 1, b - 1)],
        3 => &[(0, 0), (a - 1, b - 1), (0, b - 1)],
        4 => &[(0, 0), (a - 1, 0), (a - 1, b - 1), (0, b - 1)],
        _ => &[(0, 0), (a - 1, 0), (a / 2, b / 2), (a - 1, b - 1), (0, b - 1)],
    };
    for (x, z) in places.iter().copied() {
        site.fill(&(x..=x), &(0..=h - 1), &(z..=z), "stone");
    }
    site.fill(&(0..=a - 1), &(h..=h), &(0..=b - 1), "oak_planks");
}

/// Parameters of a roof under stress: the number of its columns.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Columns {
    n: usize,
}

/// A roof of ten by ten on balanced columns of two by two by two: the reference structures of SPEC 4. Of `materials` the
/// first makes the columns, each further one a layer.
pub fn roof_under_stress(site: &mut Site, columns: &Columns, materials: &[&str]) {
    let Some((column, layers)) = materials.split_first() else { return };
    let places = [(1, 1), (1, 7), (7, 7), (7, 1), (4, 4)];
    for (x, z) in places.into_iter().take(columns.n) {
        site.fill(&(x..=x + 1), &(0..=1), &(z..=z + 1), column);
    }
    for (y, layer) in (2..).zip(layers) {
        site.fill(&(0..=9), &(y..=y), &(0..=9), layer);
    }
}

const CONCRETE: &str = "white_concrete";

/// Parameters of a frame: its stories.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Frame {
    n: i32,
}

/// Four columns, beams at every floor, and stairs that wind up inside.
pub fn frame(site: &mut Site, frame: &Frame) {
    let top = 4 * frame.n;
    let last = 8;
    for (x, z) in [(0, 0), (last, 0), (last, last), (0, last)] {
        site.fill(&(x..=x), &(0..=top), &(z..=z), CONCRETE);
    }
    for floor in (4..=top).step_by(4) {
        site.ring(&(0..=last), &(floor..=floor), &(0..=last), CONCRETE, &|_| false);
    }
    winding_stairs(site, 4 * (frame.n - 1));
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
pub fn second_floor(site: &mut Site) {
    for (x, z) in [(0, 0), (8, 0), (8, 8), (0, 8)] {
        site.fill(&(x..=x), &(0..=4), &(z..=z), CONCRETE);
    }
    site.fill(&(0..=8), &(5..=5), &(0..=8), CONCRETE);
}
