//! Memory layout of particles for SIMD: cells lie in rows, so the neighbours of eight adjacent cells in one direction
//! are eight adjacent cells as well.
//!
//! Cells are numbered row by row, with an empty cell at the end of each row and an empty row at the end of each layer.
//! Each run of eight numbers is a block. Only blocks that hold particles, or that a window onto neighbours reaches
//! into, are stored, one after another. Parts that are not neighbours are moved together if that fills blocks better.
//! Particles without neighbours are not stored.

use std::ops::Range;

use super::neighbours::DIRECTIONS;
use crate::voxel::{Cell, CellMap};

/// Number of cells in a block: the lanes of the widest SIMD vectors.
pub const BLOCK: usize = 8;

/// Number of lanes per particle above which the layout tries to move parts together.
const WASTEFUL: usize = 4;

/// Eight adjacent cells.
#[derive(Debug, Clone)]
pub struct Block {
    /// Index of the block's first number in a field.
    pub slot: usize,
    /// Index at which the window onto neighbours in each direction begins; 0, the empty block, if there are none.
    pub ahead: [u32; 13],
    /// Index at which the window in each opposite direction begins; 0 if there are no neighbours.
    pub behind: [u32; 13],
    /// The windows ahead, but 0 where nothing could move by the forces: between particles that are held.
    pub pulling: [u32; 13],
    /// Whether any particle in the block is not held.
    pub is_free: bool,
}

/// Layout of the stored particles.
#[derive(Debug)]
pub struct Lattice {
    /// Blocks with particles, in ascending order of their indices in a field.
    pub blocks: Vec<Block>,
    /// Length of a field; the first eight numbers belong to no particle.
    pub len: usize,
    /// Index of each given cell in a field; `None` for a cell without neighbours.
    pub slot: Vec<Option<usize>>,
    /// World axis that is the lattice's first, second and third axis.
    pub axes: [usize; 3],
    /// Index into `blocks` for each run of eight numbers of a field.
    index: Vec<u32>,
}

impl Lattice {
    /// Returns the block that contains the index of a particle.
    #[must_use]
    pub fn block_at(&self, place: usize) -> &Block {
        &self.blocks[self.index[place / BLOCK] as usize]
    }

    /// Lays out `cells`; equal cells share an index.
    #[must_use]
    pub fn of(cells: &[Cell]) -> Self {
        let (blocks, numbering) = Numbering::best(&close_gaps(cells));
        if blocks * BLOCK <= WASTEFUL * cells.len() {
            return Self::from_numbers(&numbering);
        }
        let (fewer, packed) = Numbering::best(&side_by_side(cells));
        Self::from_numbers(if fewer < blocks { &packed } else { &numbering })
    }

    /// Notes which particles are held: those at indices in a field that are not free.
    pub fn hold(&mut self, is_free: impl Fn(usize) -> bool) {
        let mut is_taken = vec![false; self.len];
        for place in self.slot.iter().flatten() {
            is_taken[*place] = true;
        }
        for block in &mut self.blocks {
            let is_pulled =
                |own: usize, other: usize| is_taken[own] && is_taken[other] && (is_free(own) || is_free(other));
            for (pulling, ahead) in block.pulling.iter_mut().zip(block.ahead) {
                let acts = (0..BLOCK).any(|lane| is_pulled(block.slot + lane, ahead as usize + lane));
                *pulling = if acts { ahead } else { 0 };
            }
            block.is_free = (block.slot..block.slot + BLOCK).any(&is_free);
        }
    }

    /// Returns the indices in a field that a range of blocks spans.
    #[must_use]
    pub fn places(&self, blocks: &Range<usize>) -> Range<usize> {
        let at = |block: usize| self.blocks.get(block).map_or(self.len, |block| block.slot);
        at(blocks.start)..at(blocks.end)
    }

    /// Returns the greatest distance, in `blocks`, between a block and one that a window of it shows.
    #[must_use]
    pub fn reach(&self) -> usize {
        let before = |slot: usize| self.blocks.partition_point(|block| block.slot < slot);
        let seen = |own: usize, window: &u32| match *window as usize {
            0 => 0,
            // A window shows parts of two runs of eight numbers.
            first => own.abs_diff(before(first + 1 - BLOCK)).max(own.abs_diff(before(first + BLOCK) - 1)),
        };
        let windows = |block: &Block| block.ahead.into_iter().chain(block.behind);
        let of_block = |(own, block)| windows(block).map(|window| seen(own, &window)).max().unwrap_or(0);
        self.blocks.iter().enumerate().map(of_block).max().unwrap_or(0)
    }

    fn from_numbers(numbering: &Numbering) -> Self {
        let taken = Taken::new(&numbering.number);
        let steps = DIRECTIONS.map(|direction| numbering.step(direction));
        // For each block, the first numbers of the windows that contain neighbours.
        let look = |i: usize, step: i128| {
            let first = taken.blocks[i] * WIDTH + step;
            (taken.lanes[i] & taken.window(first) != 0).then_some(first)
        };
        let views: Vec<_> = (0..taken.blocks.len())
            .map(|i| (taken.blocks[i], steps.map(|step| look(i, step)), steps.map(|step| look(i, -step))))
            .filter(|(_, ahead, behind)| ahead.iter().chain(behind).any(Option::is_some))
            .collect();
        let mut stored = Vec::new();
        for (block, ahead, behind) in &views {
            stored.push(*block);
            for first in ahead.iter().chain(behind).flatten() {
                stored.push(first.div_euclid(WIDTH));
                stored.push((first + WIDTH - 1).div_euclid(WIDTH));
            }
        }
        stored.sort_unstable();
        stored.dedup();
        // The first block stays empty.
        let slot_of = |number: i128| {
            let rank = stored.binary_search(&number.div_euclid(WIDTH)).ok()?;
            Some((rank + 1) * BLOCK + usize::try_from(number.rem_euclid(WIDTH)).ok()?)
        };
        let window = |first: Option<i128>| first.and_then(slot_of).map_or(0, |slot| slot as u32);
        let block = |(block, ahead, behind): &(i128, [Option<i128>; 13], [Option<i128>; 13])| {
            let (slot, ahead, behind) = (slot_of(block * WIDTH)?, ahead.map(window), behind.map(window));
            Some(Block { slot, ahead, behind, pulling: ahead, is_free: true })
        };
        let blocks: Vec<Block> = views.iter().filter_map(block).collect();
        let mut index = vec![0; stored.len() + 1];
        for (i, block) in (0u32..).zip(&blocks) {
            index[block.slot / BLOCK] = i;
        }
        let has_neighbour = |number: i128| {
            steps.iter().any(|step| taken.window(number + step) & 1 != 0 || taken.window(number - step) & 1 != 0)
        };
        let slot = numbering.number.iter().map(|&n| if has_neighbour(n) { slot_of(n) } else { None });
        Self { blocks, len: (stored.len() + 1) * BLOCK, slot: slot.collect(), axes: numbering.axes, index }
    }
}

/// Number of cells in a block.
const WIDTH: i128 = BLOCK as i128;

/// Numbers that are taken by cells, block by block.
#[derive(Debug)]
struct Taken {
    /// Blocks with a taken number, ascending.
    blocks: Vec<i128>,
    /// Bit mask of each block's taken numbers, the first in the lowest bit.
    lanes: Vec<u8>,
}

impl Taken {
    fn new(numbers: &[i128]) -> Self {
        let mut sorted = numbers.to_vec();
        sorted.sort_unstable();
        let (mut blocks, mut lanes) = (Vec::new(), Vec::<u8>::new());
        for number in sorted {
            let block = number.div_euclid(WIDTH);
            if blocks.last() != Some(&block) {
                blocks.push(block);
                lanes.push(0);
            }
            if let Some(last) = lanes.last_mut() {
                *last |= 1 << number.rem_euclid(WIDTH);
            }
        }
        Self { blocks, lanes }
    }

    /// Returns the bit mask of the taken numbers among the eight from `first`.
    fn window(&self, first: i128) -> u8 {
        let block = first.div_euclid(WIDTH);
        let at = self.blocks.partition_point(|&b| b < block);
        let lanes = |i: usize, wanted: i128| match self.blocks.get(i) {
            Some(&found) if found == wanted => u16::from(self.lanes[i]),
            _ => 0,
        };
        let first_lanes = lanes(at, block);
        let next = lanes(if self.blocks.get(at) == Some(&block) { at + 1 } else { at }, block + 1);
        ((first_lanes | next << 8) >> first.rem_euclid(WIDTH)) as u8
    }
}

/// Row-by-row numbering of cells.
#[derive(Debug)]
struct Numbering {
    axes: [usize; 3],
    row: i128,
    layer: i128,
    number: Vec<i128>,
}

impl Numbering {
    /// Returns the numbering with the fewest blocks among all orders of axes, and its number of blocks.
    fn best(places: &[[i64; 3]]) -> (usize, Self) {
        let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let numbered = orders.into_iter().map(|axes| Self::new(places, axes).with_fewest_blocks());
        let none = || (0, Self { axes: [0, 1, 2], row: 1, layer: 1, number: Vec::new() });
        numbered.min_by_key(|(blocks, _)| *blocks).unwrap_or_else(none)
    }

    fn new(places: &[[i64; 3]], axes: [usize; 3]) -> Self {
        let length = |axis: usize| i128::from(places.iter().map(|place| place[axis]).max().unwrap_or(0)) + 1;
        let row = length(axes[0]) + 1;
        let layer = row * (length(axes[1]) + 1);
        let number = |place: &[i64; 3]| {
            i128::from(place[axes[0]]) + row * i128::from(place[axes[1]]) + layer * i128::from(place[axes[2]])
        };
        Self { axes, row, layer, number: places.iter().map(number).collect() }
    }

    /// Chooses the first number for which the cells take the fewest blocks, and returns that number of blocks.
    fn with_fewest_blocks(mut self) -> (usize, Self) {
        let mut sorted = self.number.clone();
        sorted.sort_unstable();
        let blocks = |first: i128| {
            let (mut count, mut last) = (0, -1);
            for number in &sorted {
                let block = (number + first) >> BLOCK.trailing_zeros();
                count += usize::from(block != last);
                last = block;
            }
            count
        };
        let (fewest, first) = (0..WIDTH).map(|first| (blocks(first), first)).min().unwrap_or_default();
        for number in &mut self.number {
            *number += first;
        }
        (fewest, self)
    }

    /// Returns the difference in number to the neighbour in a direction, given in the lattice's axes.
    fn step(&self, [x, y, z]: [i32; 3]) -> i128 {
        i128::from(x) + self.row * i128::from(y) + self.layer * i128::from(z)
    }
}

/// Returns coordinates that put parts that are not neighbours in a row along x, one empty cell apart. Each part keeps
/// its shape, and parts never act on each other, so this changes no result.
fn side_by_side(cells: &[Cell]) -> Vec<[i64; 3]> {
    let mut sorted: Vec<Cell> = cells.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    let mut place: CellMap<Option<[i64; 3]>> = sorted.iter().map(|&cell| (cell, None)).collect();
    let mut at = 0;
    for &first in &sorted {
        if place.get(&first).is_none_or(Option::is_some) {
            continue;
        }
        let mut part = vec![first];
        place.insert(first, Some([0; 3]));
        let mut seen = 0;
        while seen < part.len() {
            let cell = part[seen];
            seen += 1;
            for [x, y, z] in DIRECTIONS {
                for next in [cell.offset(x, y, z), cell.offset(-x, -y, -z)] {
                    if let Some(free @ None) = place.get_mut(&next) {
                        *free = Some([0; 3]);
                        part.push(next);
                    }
                }
            }
        }
        let along = |k: usize| part.iter().map(move |cell| i64::from(<[i32; 3]>::from(*cell)[k]));
        let least = [0, 1, 2].map(|k| along(k).min().unwrap_or(0));
        let width = along(0).max().unwrap_or(0) - least[0] + 2;
        for cell in part {
            let [x, y, z] = <[i32; 3]>::from(cell).map(i64::from);
            place.insert(cell, Some([at + x - least[0], y - least[1], z - least[2]]));
        }
        at += width;
    }
    cells.iter().map(|cell| place.get(cell).copied().flatten().unwrap_or_default()).collect()
}

/// Returns coordinates from 0 along each axis, with every gap between cells reduced to one cell.
fn close_gaps(cells: &[Cell]) -> Vec<[i64; 3]> {
    let along = |axis: usize| -> Vec<i64> {
        let coordinates: Vec<i32> = cells.iter().map(|cell| [cell.x, cell.y, cell.z][axis]).collect();
        let mut distinct = coordinates.clone();
        distinct.sort_unstable();
        distinct.dedup();
        let mut at = 0;
        let mut places = Vec::with_capacity(distinct.len());
        for (i, &coordinate) in distinct.iter().enumerate() {
            if i > 0 {
                at += if i64::from(coordinate) - i64::from(distinct[i - 1]) == 1 { 1 } else { 2 };
            }
            places.push(at);
        }
        coordinates.iter().map(|coordinate| distinct.binary_search(coordinate).map_or(0, |i| places[i])).collect()
    };
    let [x, y, z] = [along(0), along(1), along(2)];
    (0..cells.len()).map(|i| [x[i], y[i], z[i]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Lays out 500 parts of eight cells, each far from the next; stored alone, a part would take four to eight blocks.
    #[test]
    fn scattered_parts_share_blocks() {
        let part: [[i32; 3]; 8] = std::array::from_fn(|i| [i as i32 & 1, i as i32 >> 1 & 1, i as i32 >> 2]);
        let cells = (0..500).flat_map(|i| part.map(|[x, y, z]| Cell::new(x + i * 7_919, y, z + i * 104_729)));
        let blocks = Lattice::of(&cells.collect::<Vec<_>>()).blocks.len();
        assert!(blocks <= 1_500, "{blocks} blocks");
    }

    /// A floor that is held and a block on it: only the windows that show the block act, and only its own block moves.
    #[test]
    fn held_particles_pull_nobody() {
        let cells: Vec<Cell> = (0..9 * 9).map(|i| Cell::new(i % 9, 0, i / 9)).chain([Cell::new(4, 1, 4)]).collect();
        let mut lattice = Lattice::of(&cells);
        let top = lattice.slot[81].expect("the block on the floor has neighbours");
        lattice.hold(|place| place == top);
        let with_top: Vec<_> = lattice.blocks.iter().filter(|block| block.is_free).map(|block| block.slot).collect();
        assert_eq!(with_top, [top / BLOCK * BLOCK]);
        let acting = lattice.blocks.iter().flat_map(|block| block.pulling.map(|window| (block.slot, window)));
        for (slot, window) in acting.filter(|(_, window)| *window > 0) {
            let shows = |first: usize| (first..first + BLOCK).contains(&top);
            assert!(shows(slot) || shows(window as usize), "{slot} {window}");
        }
        let count = |windows: fn(&Block) -> &[u32; 13]| {
            lattice.blocks.iter().flat_map(windows).filter(|window| **window > 0).count()
        };
        assert!(count(|block| &block.pulling) >= 3);
        assert!(count(|block| &block.ahead) > 10 + count(|block| &block.pulling));
    }

    proptest! {
        /// Whatever the cells, the windows show exactly the neighbours.
        #[test]
        fn windows_show_the_neighbours(cells in prop::collection::hash_set((-3..4i32, -3..3i32, 0..4i32), 0..60),
                                       spread in prop::sample::select(vec![2, 1000, 400_000_000])) {
            let cells: Vec<Cell> =
                cells.into_iter().map(|(x, y, z)| Cell::new(x.div_euclid(2) * spread + x.rem_euclid(2), y, z)).collect();
            let lattice = Lattice::of(&cells);
            let mut cell_at = vec![None; lattice.len];
            for (cell, slot) in cells.iter().zip(&lattice.slot) {
                if let Some(slot) = *slot {
                    prop_assert!(cell_at[slot].replace(*cell).is_none());
                }
            }
            let mut seen = std::collections::HashSet::new();
            for block in &lattice.blocks {
                for (direction, (ahead, behind)) in DIRECTIONS.iter().zip(block.ahead.iter().zip(&block.behind)) {
                    let mut offset = [0; 3];
                    for (k, axis) in lattice.axes.into_iter().enumerate() {
                        offset[axis] = direction[k];
                    }
                    for lane in 0..BLOCK {
                        let Some(cell) = cell_at[block.slot + lane] else { continue };
                        for (window, sign) in [(*ahead as usize, 1), (*behind as usize, -1)] {
                            let other = cell.offset(offset[0] * sign, offset[1] * sign, offset[2] * sign);
                            let shown = cell_at[window + lane];
                            prop_assert_eq!(shown, Some(other).filter(|other| cells.contains(other)));
                            if shown.is_some() {
                                seen.insert((cell, other));
                            }
                        }
                    }
                }
            }
            let near = |a: &Cell, b: &Cell| {
                a != b && (i64::from(a.x) - i64::from(b.x)).abs() <= 1 && (a.y - b.y).abs() <= 1 && (a.z - b.z).abs() <= 1
            };
            let pairs = cells.iter().flat_map(|a| cells.iter().map(move |b| (*a, *b))).filter(|(a, b)| near(a, b));
            prop_assert_eq!(pairs.count(), seen.len());
        }
    }
}
