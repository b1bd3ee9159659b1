//! Smoothing of the equations among groups: a sweep solves those of one group after the other (Gauss-Seidel).

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::block_matrix::BlockMatrix;
use super::motions::MOTIONS;
use super::root::Root;
use crate::elasticity::Control;
use crate::elasticity::lanes::Lanes;

/// Least number of groups that are worth two shares.
const LEAST_GROUPS: usize = 5_000;
/// Number of columns that are swept before others are completed.
const RUN: usize = 32;
/// Entries of a group in the vectors here: its motions, and room up to the longest vector of numbers.
const PLACES: usize = 8;
/// Entries of a block.
const ENTRIES: usize = MOTIONS * MOTIONS;
/// Entries that are read of a block: the last column is read as long as the longest vector.
const READ: usize = ENTRIES + PLACES - MOTIONS;

/// A symmetric matrix of blocks, with one for each pair of groups that are tied. Groups of a large structure form two
/// shares, which two cores sweep at the same time.
#[derive(Debug)]
pub struct Sweeps {
    first: Share,
    second: Option<Share>,
    /// Groups of the second share that are tied to groups of the first, with the latter and the block.
    between: Vec<(u32, u32, [[f64; MOTIONS]; MOTIONS])>,
    arch: Arch,
}

/// Equations of the groups of a share, counted from its first, and vectors of them.
#[derive(Debug, Default)]
struct Share {
    /// First entry below the diagonal of each column, and the number of entries.
    start: Vec<usize>,
    row: Vec<u32>,
    /// Blocks, one after the other, by columns.
    block: Vec<f64>,
    diagonal: Vec<f64>,
    inverse: Vec<f64>,
    /// For each run of columns, the number of groups, from the first, that contains all that are tied to it or to those
    /// before it.
    reached: Vec<usize>,
    moved: Vec<f64>,
    added: Vec<f64>,
    rest: Vec<f64>,
}

impl Sweeps {
    /// Prepares the sweeps of a matrix.
    #[must_use]
    pub fn new(matrix: &BlockMatrix) -> Self {
        let groups = matrix.len();
        let middle = if groups < LEAST_GROUPS { groups } else { groups / 2 };
        let mut between = Vec::new();
        for column in 0..middle {
            for (row, block) in matrix.row(column).filter(|(row, _)| *row >= middle) {
                between.push((row as u32, column as u32, block.transpose().data.0));
            }
        }
        let second = (middle < groups).then(|| Share::new(matrix, middle..groups));
        Self { first: Share::new(matrix, 0..middle), second, between, arch: Arch::new() }
    }

    /// Returns the number of unknowns.
    #[must_use]
    pub fn len(&self) -> usize {
        MOTIONS * (self.first.len() + self.second.as_ref().map_or(0, Share::len))
    }

    /// Writes to `added` a rough solution for what the motions `moved` leave of a force: it solves the equations of each
    /// group after those of the groups of its share before it. Subtracts from `rest`, which holds the force, what all these
    /// motions pull, apart from motions that an inverse leaves out. The numbers do not depend on whether `control` lends
    /// cores.
    pub fn improve(&mut self, control: &Control<'_>, moved: &[f64], added: &mut [f64], rest: &mut [f64]) {
        self.subtract_between(moved, rest);
        let at = MOTIONS * self.first.len();
        let (moved_first, moved_second) = moved.split_at(at);
        let (added_first, added_second) = added.split_at_mut(at);
        let (rest_first, rest_second) = rest.split_at_mut(at);
        let arch = self.arch;
        let first = &mut self.first;
        match &mut self.second {
            None => first.improve(arch, moved_first, added_first, rest_first),
            Some(second) => control.both(
                || first.improve(arch, moved_first, added_first, rest_first),
                || second.improve(arch, moved_second, added_second, rest_second),
            ),
        }
        self.subtract_between(added, rest);
    }

    /// Subtracts from `rest` what pairs of groups of both shares pull by these motions.
    fn subtract_between(&self, motion: &[f64], rest: &mut [f64]) {
        for (row, column, block) in &self.between {
            let (of_row, of_column) = (MOTIONS * *row as usize, MOTIONS * *column as usize);
            for k in 0..MOTIONS {
                for i in 0..MOTIONS {
                    rest[of_row + i] -= block[k][i] * motion[of_column + k];
                }
                let pulled: f64 = (0..MOTIONS).map(|i| block[k][i] * motion[of_row + i]).sum();
                rest[of_column + k] -= pulled;
            }
        }
    }
}

impl Share {
    /// Takes the equations of some groups.
    fn new(matrix: &BlockMatrix, groups: Range<usize>) -> Self {
        let mut share = Self { start: vec![0], ..Self::default() };
        let mut reached = 0;
        for column in groups.clone() {
            for (row, block) in matrix.row(column).filter(|(row, _)| (column..groups.end).contains(row)) {
                if row == column {
                    share.diagonal.extend(block.iter());
                    share.inverse.extend(Root::new(block, &block.diagonal()).inverse().as_flattened());
                } else {
                    // The matrix is symmetric; what is read as a row is stored as a column.
                    share.row.push((row - groups.start) as u32);
                    share.block.extend(block.transpose().iter());
                    reached = reached.max(row - groups.start + 1);
                }
            }
            share.start.push(share.row.len());
            if share.start.len() % RUN == 1 {
                share.reached.push(reached);
            }
        }
        if !groups.len().is_multiple_of(RUN) {
            share.reached.push(reached);
        }
        for blocks in [&mut share.block, &mut share.diagonal, &mut share.inverse] {
            blocks.resize(blocks.len() + READ - ENTRIES, 0.0);
        }
        for vector in [&mut share.moved, &mut share.added, &mut share.rest] {
            vector.resize(PLACES * groups.len(), 0.0);
        }
        share
    }

    /// Returns the number of groups.
    fn len(&self) -> usize {
        self.start.len() - 1
    }

    fn improve(&mut self, arch: Arch, moved: &[f64], added: &mut [f64], rest: &mut [f64]) {
        let places = |vector: &mut [f64], from: &[f64]| {
            for (places, from) in vector.chunks_exact_mut(PLACES).zip(from.chunks_exact(MOTIONS)) {
                places[..MOTIONS].copy_from_slice(from);
            }
        };
        places(&mut self.moved, moved);
        places(&mut self.rest, rest);
        arch.dispatch(Improve(self));
        for (to, vector) in [(added, &self.added), (rest, &self.rest)] {
            for (to, places) in to.chunks_exact_mut(MOTIONS).zip(vector.chunks_exact(PLACES)) {
                to.copy_from_slice(&places[..MOTIONS]);
            }
        }
    }
}

struct Improve<'a>(&'a mut Share);

impl WithSimd for Improve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(share) = self;
        let columns = |run: usize, groups: usize| run * RUN..groups.min((run + 1) * RUN);
        let groups = share.len();
        let mut completed = 0;
        for run in 0..share.reached.len() {
            columns(run, groups).for_each(|column| share.sweep(simd, column));
            // What follows finds the blocks in the cache.
            let swept = columns(run, groups).end;
            while completed < share.reached.len() && share.reached[completed].max(completed * RUN + 1) <= swept {
                columns(completed, groups).for_each(|column| share.complete(simd, column));
                completed += 1;
            }
        }
    }
}

impl Share {
    /// Solves the equations of a group, and subtracts from the rest of later groups what all its motions pull. The rest
    /// of its own is what later motions will pull.
    #[inline(always)]
    fn sweep<S: Simd>(&mut self, simd: S, column: usize) {
        let at = PLACES * column;
        let pulled = self.pulled_by_later(simd, column, &self.moved);
        for (rest, pulled) in self.rest[at..].iter_mut().zip(pulled) {
            *rest -= pulled;
        }
        let own = motions(simd, &self.moved[at..]);
        subtract_product(simd, &self.diagonal[ENTRIES * column..], &own, &mut self.rest[at..]);
        let own = motions(simd, &self.rest[at..]);
        self.added[at..at + PLACES].fill(0.0);
        // The solution is what an inverse of the other sign would subtract.
        subtract_product(simd, &self.inverse[ENTRIES * column..], &own, &mut self.added[at..]);
        let mut all = [0.0; MOTIONS];
        for k in 0..MOTIONS {
            self.added[at + k] = -self.added[at + k];
            all[k] = self.moved[at + k] + self.added[at + k];
        }
        let all = motions(simd, &all);
        for entry in self.start[column]..self.start[column + 1] {
            let block = &self.block[ENTRIES * entry..ENTRIES * entry + READ];
            subtract_product(simd, block, &all, &mut self.rest[PLACES * self.row[entry] as usize..]);
        }
    }

    /// Computes the rest of a group: its own equations were solved, apart from motions that the inverse leaves out, and later
    /// groups have moved since.
    #[inline(always)]
    fn complete<S: Simd>(&mut self, simd: S, column: usize) {
        let pulled = self.pulled_by_later(simd, column, &self.added);
        for (rest, pulled) in self.rest[PLACES * column..].iter_mut().zip(pulled) {
            *rest = -pulled;
        }
    }

    /// Returns what the motions of later groups pull at a group.
    #[inline(always)]
    fn pulled_by_later<S: Simd>(&self, simd: S, column: usize, motion: &[f64]) -> [f64; MOTIONS] {
        let mut products = [[0.0; PLACES]; MOTIONS];
        for first in (0..PLACES).step_by(S::F64_LANES) {
            let mut sums = [Lanes::splat(simd, 0.0); MOTIONS];
            for entry in self.start[column]..self.start[column + 1] {
                let block = &self.block[ENTRIES * entry..ENTRIES * entry + READ];
                let moved = Lanes::load(simd, motion, PLACES * self.row[entry] as usize + first);
                for k in 0..MOTIONS {
                    sums[k] = Lanes::load(simd, block, MOTIONS * k + first).mul_add(moved, sums[k]);
                }
            }
            for k in 0..MOTIONS {
                sums[k].store(&mut products[k], first);
            }
        }
        // Beyond the motions is what a vector has read of other columns.
        products.map(|products| products[..MOTIONS].iter().sum())
    }
}

/// Returns each of the motions of a group in all lanes.
#[inline(always)]
fn motions<S: Simd>(simd: S, places: &[f64]) -> [Lanes<S>; MOTIONS] {
    std::array::from_fn(|k| Lanes::splat(simd, places[k]))
}

/// Subtracts from the places of a group the product of a block and motions.
#[inline(always)]
fn subtract_product<S: Simd>(simd: S, block: &[f64], motions: &[Lanes<S>; MOTIONS], from: &mut [f64]) {
    for first in (0..PLACES).step_by(S::F64_LANES) {
        let mut rest = Lanes::load(simd, from, first);
        for k in 0..MOTIONS {
            rest = Lanes::load(simd, block, MOTIONS * k + first).subtract_product_from(motions[k], rest);
        }
        rest.store(from, first);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::elasticity::fem::ELEMENT;
    use crate::elasticity::fem::mesh::{Mesh, Supported};
    use crate::elasticity::fem::motions::Motions;
    use crate::elasticity::fem::partition::Partition;
    use crate::elasticity::fem::system::System;
    use crate::elasticity::tests::on_two_threads;
    use crate::voxel::Cell;

    /// Stiffness among the groups of a wall with windows.
    fn equations(width: i32, height: i32) -> BlockMatrix {
        let cells = (0..width * height).map(|i| Cell::new(i % width, i / width, 0));
        let cells = cells.filter(|c| !(2..4).contains(&(c.x % 6)) || c.y % 6 != 3);
        let mesh = Mesh::new(Supported::of(&cells.collect::<Vec<_>>()).cells);
        let system = System::new(&mesh, &ELEMENT, 1.0, |position| position[1] == 0);
        let position: Vec<_> = mesh.position.iter().map(|position| position.map(f64::from).into()).collect();
        BlockMatrix::of_system(&system, &Motions::new(Partition::of_nodes(&system), &position))
    }

    /// Returns the product of a matrix, or of the part that `counts` by row and column, with a vector.
    fn product(matrix: &BlockMatrix, vector: &[f64], counts: impl Fn(usize, usize) -> bool) -> Vec<f64> {
        let mut product = vec![0.0; vector.len()];
        for row in 0..matrix.len() {
            for (column, block) in matrix.row(row).filter(|(column, _)| counts(row, *column)) {
                let moved = Vector6::from_column_slice(&vector[MOTIONS * column..][..MOTIONS]);
                for (product, pulled) in product[MOTIONS * row..].iter_mut().zip((block * moved).iter()) {
                    *product += pulled;
                }
            }
        }
        product
    }

    #[test]
    fn a_sweep_leaves_what_it_says() {
        for (width, height, shares) in [(6, 6, 1), (200, 150, 2)] {
            let matrix = equations(width, height);
            let mut sweeps = Sweeps::new(&matrix);
            assert_eq!(1 + usize::from(sweeps.second.is_some()), shares);
            let middle = sweeps.first.len();
            // A second sweep finds nothing of the first.
            for seed in [1.0, 0.7] {
                let force: Vec<f64> = (0..sweeps.len()).map(|i| (seed * i as f64).sin()).collect();
                let moved: Vec<f64> = (0..sweeps.len()).map(|i| 1e-9 * (seed * i as f64).cos()).collect();
                let (mut added, mut rest) = (force.clone(), force.clone());
                sweeps.improve(&Control::unhurried(), &moved, &mut added, &mut rest);
                let on_two = Control { join: Some(&on_two_threads), ..Control::unhurried() };
                let (mut added_on_two, mut rest_on_two) = (force.clone(), force.clone());
                sweeps.improve(&on_two, &moved, &mut added_on_two, &mut rest_on_two);
                assert_eq!((&added, &rest), (&added_on_two, &rest_on_two));
                let pulled = [&moved, &added].map(|vector| product(&matrix, vector, |_, _| true));
                // With the groups of its share before it, and without those after it, each group is in equilibrium.
                let is_before = |row, column| column <= row && (row < middle) == (column < middle);
                let by_those_before = product(&matrix, &added, is_before);
                for i in 0..force.len() {
                    assert!((force[i] - pulled[0][i] - pulled[1][i] - rest[i]).abs() < 1e-9, "{i}");
                    assert!((force[i] - pulled[0][i] - by_those_before[i]).abs() < 1e-9, "{i}");
                }
            }
        }
    }
}
