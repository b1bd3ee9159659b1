//! Where a search for slow builds begins, and the changes by which it climbs.

use plumbline_engine::voxel::cell::MAX_Y;
use rand_mt::Mt64;

use super::strokes::{MATERIALS, Stroke};

/// Greatest number of strokes.
const MAX_STROKES: usize = 8;

impl Stroke {
    fn lattice(steps: [[i32; 3]; 3], counts: [usize; 3]) -> Self {
        Self::Lattice { from: [0; 3], steps, counts: counts.map(|count| count as u32), material: 0 }
    }

    fn scatter(size: [u32; 3], count: usize) -> Self {
        Self::Scatter { from: [0; 3], size, count: count as u32, seed: 7, material: 0 }
    }

    /// A lattice somewhere else, of another material.
    fn at(mut self, from: [i32; 3], material: usize) -> Self {
        *self.from() = from;
        *self.material() = material;
        self
    }

    fn from(&mut self) -> &mut [i32; 3] {
        match self {
            Self::Lattice { from, .. } | Self::Scatter { from, .. } => from,
        }
    }

    fn material(&mut self) -> &mut usize {
        match self {
            Self::Lattice { material, .. } | Self::Scatter { material, .. } => material,
        }
    }
}

/// Builds to begin with: solid, flat, thin, in checks, in steps, and scattered.
pub fn beginnings(most: usize) -> Vec<Vec<Stroke>> {
    let side = (most as f64).cbrt().ceil() as usize;
    let plane = (most as f64).sqrt().ceil() as usize;
    let (x, y, z) = ([1, 0, 0], [0, 1, 0], [0, 0, 1]);
    let mut checks = vec![Stroke::lattice([[2, 0, 0], [0, 0, 2], y], [plane / 2, plane, 1]); 2];
    checks[1] = checks[1].clone().at([1, 0, 1], 1);
    let alone = [
        Stroke::lattice([y, x, z], [side, side, side]),
        Stroke::lattice([x, z, y], [plane, plane, 1]),
        Stroke::lattice([y, x, z], [plane.min(250), most.div_ceil(plane.min(250)), 1]),
        Stroke::lattice([x, y, z], [most, 1, 1]),
        Stroke::lattice([[1, 0, 1], y, z], [most, 1, 1]),
        Stroke::lattice([z, [1, 1, 0], y], [most.div_ceil(100), 100, 1]),
        Stroke::lattice([y, [2, 0, 0], [0, 0, 2]], [100, most.div_ceil(1_000), 10]),
        Stroke::lattice([[3, 0, 0], [0, 0, 3], y], [plane, plane, 1]),
        Stroke::scatter([20, 20, 20], 2 * most),
        Stroke::scatter([60, 60, 60], 2 * most),
        Stroke::scatter([120, 120, 120], most),
        Stroke::scatter([120, 1, 120], 2 * most),
        Stroke::scatter([1_000, 300, 1_000], most),
        Stroke::scatter([10_000_000, 300, 10_000_000], most),
        Stroke::scatter([10_000_000, 1, 10_000_000], most),
    ];
    let halls = [[2, 2, 2], [15, 15, 15], [15, 1, 15]].map(|gaps| hall(most, gaps));
    let shaped = [filled_hall(most), floor_with_beds(plane / 2), arch(most), span(most)];
    alone.into_iter().map(|stroke| vec![stroke]).chain([checks]).chain(halls).chain(shaped).collect()
}

/// Returns a hall of about so many blocks, whose walls, floor and ceiling are single blocks with gaps, and a bed in its
/// middle.
fn hall(most: usize, gaps: [i32; 3]) -> Vec<Stroke> {
    // Faces have the same number of blocks along each axis.
    let along = ((most / 6) as f64).sqrt() as i32 - 1;
    let steps = gaps.map(|gap| along.min(MAX_Y / gap));
    let [x, top, z] = std::array::from_fn(|axis| steps[axis] * gaps[axis]);
    let face = |from: [i32; 3], one: usize, other: usize| {
        let step = |axis: usize| std::array::from_fn(|at| if at == axis { gaps[axis] } else { 0 });
        let count = |axis: usize| steps[axis] as usize + 1;
        Stroke::lattice([step(one), step(other), [0; 3]], [count(one), count(other), 1]).at(from, 0)
    };
    vec![
        Stroke::lattice([[0; 3]; 3], [1; 3]).at([x / 2, top / 2, z / 2], 3),
        face([0, 0, 0], 0, 1),
        face([0, 0, z], 0, 1),
        face([0, 0, 0], 2, 1),
        face([x, 0, 0], 2, 1),
        face([0, 0, 0], 0, 2),
        face([0, top, 0], 0, 2),
    ]
}

/// Returns a closed hall with single blocks in it that leave many ways, and beds to start from.
fn filled_hall(most: usize) -> Vec<Stroke> {
    // A block in 5,000 cells leaves a large box about as much free as blocked space.
    let (blocks, beds) = (most / 2, most / 20);
    let along = (((blocks * 5_000) as f64).cbrt() as u32 / 15).min(MAX_Y as u32 / 15);
    let mut strokes = hall(6 * (along as usize + 1).pow(2), [15; 3]);
    strokes[0] = Stroke::scatter([15 * along; 3], beds).at([0; 3], 3);
    strokes.push(Stroke::scatter([15 * along; 3], blocks));
    strokes
}

/// Returns a square floor below the ground with beds on all of it but its edge.
fn floor_with_beds(side: usize) -> Vec<Stroke> {
    let square = |side| Stroke::lattice([[1, 0, 0], [0, 0, 1], [0; 3]], [side, side, 1]);
    vec![square(side).at([0, -1, 0], 0), square(side.saturating_sub(2)).at([1, 0, 1], 3)]
}

/// Returns two ramps that meet at the top: an arch as wide as it is high.
fn arch(most: usize) -> Vec<Stroke> {
    let side = ((most / 2) as f64).sqrt() as usize;
    let ramp = |forth| Stroke::lattice([[forth, 1, 0], [0, 0, 1], [0; 3]], [side, side, 1]);
    vec![ramp(1), ramp(-1).at([2 * side as i32 - 1, 0, 0], 0)]
}

/// Returns two walls with a deck on them.
fn span(most: usize) -> Vec<Stroke> {
    let side = ((most / 2) as f64).sqrt() as usize;
    let wall = || Stroke::lattice([[0, 1, 0], [0, 0, 1], [0; 3]], [1, side, 1]);
    let deck = Stroke::lattice([[1, 0, 0], [0, 0, 1], [0; 3]], [side, side, 1]).at([0, 1, 0], 6);
    vec![wall(), wall().at([side as i32 - 1, 0, 0], 0), deck]
}

fn below(random: &mut Mt64, count: u64) -> u64 {
    random.next_u64() % count.max(1)
}

/// Returns a number near another one, or half or twice as much.
fn near(random: &mut Mt64, number: u32, most: u32) -> u32 {
    let changed = match below(random, 4) {
        0 => number.saturating_add(1 + below(random, 3) as u32),
        1 => number.saturating_sub(1 + below(random, 3) as u32),
        2 => number.saturating_mul(2),
        _ => number / 2,
    };
    changed.clamp(1, most)
}

/// Returns strokes of which one is changed, added, doubled or left out.
pub fn changed(strokes: &[Stroke], most: usize, random: &mut Mt64) -> Vec<Stroke> {
    let mut strokes = strokes.to_vec();
    for _ in 0..=below(random, 2) {
        let which = below(random, strokes.len() as u64) as usize;
        match below(random, 10) {
            0 if strokes.len() < MAX_STROKES => {
                let all = beginnings(most);
                strokes.extend(all[below(random, all.len() as u64) as usize].iter().cloned());
            }
            1 if strokes.len() < MAX_STROKES => {
                let mut copy = strokes[which].clone();
                copy.from()[below(random, 3) as usize] += below(random, 9) as i32 - 4;
                strokes.insert(0, copy);
            }
            2 if strokes.len() > 1 => {
                strokes.remove(which);
            }
            3 => strokes.rotate_left(which),
            4 => *strokes[which].material() = below(random, MATERIALS.len() as u64) as usize,
            5 => strokes[which].from()[below(random, 3) as usize] += below(random, 5) as i32 - 2,
            _ => change(&mut strokes[which], most, random),
        }
    }
    strokes
}

fn change(stroke: &mut Stroke, most: usize, random: &mut Mt64) {
    let axis = below(random, 3) as usize;
    match stroke {
        Stroke::Lattice { steps, counts, .. } => match below(random, 3) {
            0 => steps[below(random, 3) as usize][axis] += below(random, 3) as i32 - 1,
            1 => counts[axis] = near(random, counts[axis], most as u32),
            _ => {
                // As many cells, in another shape.
                let other = (axis + 1) % 3;
                counts[axis] = counts[axis].saturating_mul(2).min(most as u32);
                counts[other] = (counts[other] / 2).max(1);
            }
        },
        Stroke::Scatter { size, count, seed, .. } => match below(random, 3) {
            0 => size[axis] = near(random, size[axis], 20_000_000),
            1 => *count = near(random, *count, 2 * most as u32),
            _ => *seed = random.next_u64(),
        },
    }
}
