//! Structural elements: foundations, walls, roofs on columns, frames.

use serde::Deserialize;

use super::materials;
use super::site::Site;
use crate::voxel::Cell;

/// Parameters of a slab: sides of its plan and its depth, in blocks.
#[derive(Debug, Clone, Deserialize)]
pub struct Slab {
    a: i32,
    b: i32,
    d: i32,
    #[serde(default = "materials::stone")]
    material: String,
}

/// Builds a slab in the ground, with its top at y = -1.
pub fn foundation(site: &mut Site, slab: &Slab) {
    site.fill(&(0..=slab.a - 1), &(-slab.d..=-1), &(0..=slab.b - 1), &slab.material);
}

/// Parameters of a deep foundation: plan and thickness of its cap, number and depth of its piles.
#[derive(Debug, Clone, Deserialize)]
pub struct DeepFoundation {
    a: i32,
    b: i32,
    t: i32,
    p: usize,
    #[serde(default = "five")]
    depth: i32,
    #[serde(default = "materials::stone")]
    material: String,
}

const fn five() -> i32 {
    5
}

/// Builds a cap, with its top at y = 0, on piles.
pub fn deep_foundation(site: &mut Site, foundation: &DeepFoundation) {
    let DeepFoundation { a, b, t, p, depth, ref material } = *foundation;
    let lowest = 1 - t - depth;
    let places = [(1, 1), (a / 2, 1), (a - 2, 1), (a - 2, b - 2), (a / 2, b - 2), (1, b - 2)];
    // Four piles stand in the corners, a fifth in the middle of a side, a sixth opposite it.
    let order: &[usize] = if p == 4 { &[0, 2, 3, 5] } else { &[0, 1, 2, 3, 4, 5] };
    let order = if p == 5 { &[0, 1, 2, 3, 5] } else { order };
    for (x, z) in order.iter().filter_map(|&i| places.get(i)).copied() {
        site.fill(&(x..=x), &(lowest..=lowest + depth - 1), &(z..=z), material);
    }
    site.fill(&(0..=a - 1), &(1 - t..=0), &(0..=b - 1), material);
}

/// Parameters of a wall: width, thickness and height, in blocks.
#[derive(Debug, Clone, Deserialize)]
pub struct Wall {
    w: i32,
    t: i32,
    h: i32,
    #[serde(default = "materials::stone")]
    material: String,
}

/// Builds a wall on the ground.
pub fn wall(site: &mut Site, wall: &Wall) {
    site.fill(&(0..=wall.t - 1), &(0..=wall.h - 1), &(0..=wall.w - 1), &wall.material);
}

/// Parameters of a roof: its plan, and the height and number of its columns.
#[derive(Debug, Clone, Deserialize)]
pub struct Roof {
    a: i32,
    b: i32,
    h: i32,
    n: usize,
    #[serde(default = "materials::stone")]
    column: String,
    #[serde(default = "materials::oak_planks")]
    cover: String,
}

/// Builds a flat roof of one layer on columns one block thick.
pub fn roof_on_columns(site: &mut Site, roof: &Roof) {
    let Roof { a, b, h, n, ref column, ref cover } = *roof;
    let places: &[(i32, i32)] = match n {
        2 => &[(0, 0), (a - 1, b - 1)],
        3 => &[(0, 0), (a - 1, b - 1), (0, b - 1)],
        4 => &[(0, 0), (a - 1, 0), (a - 1, b - 1), (0, b - 1)],
        _ => &[(0, 0), (a - 1, 0), (a / 2, b / 2), (a - 1, b - 1), (0, b - 1)],
    };
    for (x, z) in places.iter().copied() {
        site.fill(&(x..=x), &(0..=h - 1), &(z..=z), column);
    }
    site.fill(&(0..=a - 1), &(h..=h), &(0..=b - 1), cover);
}

/// Parameters of a roof under stress: number and height of its columns, and length of its sides.
#[derive(Debug, Clone, Deserialize)]
pub struct Columns {
    n: usize,
    #[serde(default = "two")]
    height: i32,
    #[serde(default = "ten")]
    side: i32,
    /// Material of the columns, then that of each layer from the lowest up; empty for the default materials.
    #[serde(default)]
    materials: Vec<String>,
}

const fn two() -> i32 {
    2
}

const fn ten() -> i32 {
    10
}

/// Builds a square roof on balanced columns of two by two. Ten by ten on columns two high are the reference structures
/// of `docs/rules.md#stress`. The first material is for the columns, each further one for a layer; `materials` are the
/// defaults.
pub fn roof_under_stress(site: &mut Site, columns: &Columns, materials: &[&str]) {
    let Columns { n, height, side, materials: ref own } = *columns;
    let own: Vec<&str> = own.iter().map(String::as_str).collect();
    let Some((column, layers)) = (if own.is_empty() { materials } else { &own }).split_first() else { return };
    let (far, middle) = (side - 3, side / 2 - 1);
    let places = [(1, 1), (1, far), (far, far), (far, 1), (middle, middle)];
    for (x, z) in places.into_iter().take(n) {
        site.fill(&(x..=x + 1), &(0..=height - 1), &(z..=z + 1), column);
    }
    for (y, layer) in (height..).zip(layers) {
        site.fill(&(0..=side - 1), &(y..=y), &(0..=side - 1), layer);
    }
}

/// Parameters of a frame: the number and height of its stories, and the distance between its columns.
#[derive(Debug, Clone, Deserialize)]
pub struct Frame {
    n: i32,
    #[serde(default = "four")]
    story: i32,
    #[serde(default = "eight")]
    bay: i32,
    #[serde(default = "materials::white_concrete")]
    material: String,
}

const fn four() -> i32 {
    4
}

const fn eight() -> i32 {
    8
}

/// Builds four columns with beams at every floor, and stairs that wind up inside.
pub fn frame(site: &mut Site, frame: &Frame) {
    let Frame { n, story, bay: last, ref material } = *frame;
    let top = story * n;
    for (x, z) in [(0, 0), (last, 0), (last, last), (0, last)] {
        site.fill(&(x..=x), &(0..=top), &(z..=z), material);
    }
    for floor in (1..=n).map(|floor| floor * story) {
        site.ring(&(0..=last), &(floor..=floor), &(0..=last), material, &|_| false);
    }
    winding_stairs(site, story * (n - 1), material);
}

/// Builds stairs around a square of five by five up to `top`, each step on a block of its own.
fn winding_stairs(site: &mut Site, top: i32, material: &str) {
    let side = |from: (i32, i32), step: (i32, i32)| (0..4).map(move |i| (from.0 + i * step.0, from.1 + i * step.1));
    let round: Vec<(i32, i32)> = side((2, 2), (1, 0))
        .chain(side((6, 2), (0, 1)))
        .chain(side((6, 6), (-1, 0)))
        .chain(side((2, 6), (0, -1)))
        .collect();
    for (y, (x, z)) in (0..=top).zip(round.into_iter().cycle()) {
        if y > 0 {
            site.place(Cell::new(x, y - 1, z), material);
        }
        site.place(Cell::new(x, y, z), material);
    }
}

/// Parameters of a slab on columns: the number of columns, four to six, and the slab's plan and level.
#[derive(Debug, Clone, Deserialize)]
pub struct Platform {
    #[serde(default = "four_columns")]
    n: usize,
    #[serde(default = "nine")]
    a: i32,
    #[serde(default = "nine")]
    b: i32,
    #[serde(default = "five")]
    h: i32,
    #[serde(default = "materials::white_concrete")]
    material: String,
}

const fn four_columns() -> usize {
    4
}

const fn nine() -> i32 {
    9
}

/// Builds the slab of a second floor on columns in the corners, and on a fifth and sixth in the middle of two sides.
pub fn platform(site: &mut Site, platform: &Platform) {
    let Platform { n, a, b, h, ref material } = *platform;
    let (x, z) = (a - 1, b - 1);
    for (x, z) in [(0, 0), (x, 0), (x, z), (0, z), (x / 2, 0), (x / 2, z)].into_iter().take(n) {
        site.fill(&(x..=x), &(0..=h - 1), &(z..=z), material);
    }
    site.fill(&(0..=x), &(h..=h), &(0..=z), material);
}

/// Parameters of a solid flight of terraces: their number, the depth of each, and the width of all.
#[derive(Debug, Clone, Deserialize)]
pub struct Terraces {
    steps: i32,
    tread: i32,
    width: i32,
    material: String,
}

/// Builds terraces, each one block higher than the one before, solid down to the ground.
pub fn terraces(site: &mut Site, terraces: &Terraces) {
    let Terraces { steps, tread, width, ref material } = *terraces;
    for y in 0..steps {
        site.fill(&(y * tread..=steps * tread - 1), &(y..=y), &(0..=width - 1), material);
    }
}
