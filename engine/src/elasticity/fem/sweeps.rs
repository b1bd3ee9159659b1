//! Smoothing of the equations among groups: a sweep solves those of one group after the other (Gauss-Seidel).

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use pulp::{Arch, Simd, WithSimd};

use super::block_matrix::BlockMatrix;
use super::motions::MOTIONS;
use super::root::Root;

/// Forces or motions of a group.
type Six = [f64; MOTIONS];
/// Entries of a block, by columns.
type Block = [Six; MOTIONS];

/// A symmetric matrix of blocks, with one for each pair of groups that are tied, and the inverses of its diagonal.
#[derive(Debug)]
pub struct Sweeps {
    /// First entry below the diagonal of each row, and the number of entries.
    start: Vec<usize>,
    column: Vec<u32>,
    block: Vec<Block>,
    diagonal: Vec<Block>,
    inverse: Vec<Block>,
    arch: Arch,
}

impl Sweeps {
    /// Prepares the sweeps of a matrix.
    #[must_use]
    pub fn new(matrix: &BlockMatrix) -> Self {
        let mut sweeps = Self {
            start: vec![0],
            column: Vec::new(),
            block: Vec::new(),
            diagonal: Vec::with_capacity(matrix.len()),
            inverse: Vec::with_capacity(matrix.len()),
            arch: Arch::new(),
        };
        for row in 0..matrix.len() {
            for (column, block) in matrix.row(row).take_while(|(column, _)| *column <= row) {
                if column == row {
                    sweeps.diagonal.push(block.data.0);
                    sweeps.inverse.push(Root::new(block, &block.diagonal()).inverse());
                } else {
                    sweeps.column.push(column as u32);
                    sweeps.block.push(block.data.0);
                }
            }
            sweeps.start.push(sweeps.column.len());
        }
        sweeps
    }

    /// Returns the number of unknowns.
    #[must_use]
    pub fn len(&self) -> usize {
        MOTIONS * self.diagonal.len()
    }

    /// Solves the equations of each group after those of the groups before it: writes a rough solution for `force`, and
    /// the force that it leaves.
    pub fn sweep(&self, force: &[f64], solution: &mut [f64], rest: &mut [f64]) {
        self.arch.dispatch(Sweep { sweeps: self, force, solution, rest });
    }

    /// Computes the product with a vector.
    pub fn multiply(&self, vector: &[f64], product: &mut [f64]) {
        self.arch.dispatch(Multiply { sweeps: self, vector, product });
    }

    /// Returns the columns and blocks of a row below the diagonal.
    #[inline(always)]
    fn below(&self, row: usize) -> impl Iterator<Item = (usize, &Block)> {
        let range = self.start[row]..self.start[row + 1];
        self.column[range.clone()].iter().map(|&column| column as usize).zip(&self.block[range])
    }
}

struct Sweep<'a> {
    sweeps: &'a Sweeps,
    force: &'a [f64],
    solution: &'a mut [f64],
    rest: &'a mut [f64],
}

impl WithSimd for Sweep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for row in 0..self.sweeps.diagonal.len() {
            let mut own = part(self.force, row);
            for (column, block) in self.sweeps.below(row) {
                let pulled = product(block, part(self.solution, column));
                own = std::array::from_fn(|k| own[k] - pulled[k]);
            }
            let moved = product(&self.sweeps.inverse[row], own);
            *part_mut(self.solution, row) = moved;
            // Its own equations are solved; those of groups before it have been, and no longer are.
            *part_mut(self.rest, row) = [0.0; MOTIONS];
            for (column, block) in self.sweeps.below(row) {
                subtract(part_mut(self.rest, column), transposed_product(block, moved));
            }
        }
    }
}

struct Multiply<'a> {
    sweeps: &'a Sweeps,
    vector: &'a [f64],
    product: &'a mut [f64],
}

impl WithSimd for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for row in 0..self.sweeps.diagonal.len() {
            let own = part(self.vector, row);
            let mut sum = product(&self.sweeps.diagonal[row], own);
            for (column, block) in self.sweeps.below(row) {
                let pulled = product(block, part(self.vector, column));
                sum = std::array::from_fn(|k| sum[k] + pulled[k]);
                let pulled = transposed_product(block, own);
                let of_column = part_mut(self.product, column);
                *of_column = std::array::from_fn(|k| of_column[k] + pulled[k]);
            }
            *part_mut(self.product, row) = sum;
        }
    }
}

#[inline(always)]
fn part(vector: &[f64], group: usize) -> Six {
    *vector[MOTIONS * group..].first_chunk().expect("a vector has six entries for each group")
}

#[inline(always)]
fn part_mut(vector: &mut [f64], group: usize) -> &mut Six {
    vector[MOTIONS * group..].first_chunk_mut().expect("a vector has six entries for each group")
}

#[inline(always)]
fn subtract(from: &mut Six, part: Six) {
    *from = std::array::from_fn(|k| from[k] - part[k]);
}

#[inline(always)]
fn product(block: &Block, vector: Six) -> Six {
    let mut product = [0.0; MOTIONS];
    for (column, factor) in block.iter().zip(vector) {
        for k in 0..MOTIONS {
            product[k] += column[k] * factor;
        }
    }
    product
}

#[inline(always)]
fn transposed_product(block: &Block, vector: Six) -> Six {
    // Sums of two, so that two numbers are added at a time.
    block.map(|column| {
        let pair: [f64; 2] = std::array::from_fn(|k| {
            column[k] * vector[k] + column[k + 2] * vector[k + 2] + column[k + 4] * vector[k + 4]
        });
        pair[0] + pair[1]
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::elasticity::fem::ELEMENT;
    use crate::elasticity::fem::mesh::Mesh;
    use crate::elasticity::fem::motions::Motions;
    use crate::elasticity::fem::partition::Partition;
    use crate::elasticity::fem::system::System;
    use crate::voxel::Cell;

    #[test]
    fn a_sweep_leaves_what_it_says() {
        // A wall with a window, whose groups are tied in a ring.
        let cells = (0..6 * 6).map(|i| Cell::new(i % 6, i / 6, 0)).filter(|c| !(2..4).contains(&c.x) || c.y != 3);
        let mesh = Mesh::new(cells.collect());
        let system = System::new(&mesh, &ELEMENT, 1.0, |position| position[1] == 0);
        let position: Vec<_> = mesh.position.iter().map(|position| position.map(f64::from).into()).collect();
        let matrix = BlockMatrix::of_system(&system, &Motions::new(Partition::of_nodes(&system), &position));
        let sweeps = Sweeps::new(&matrix);
        let len = sweeps.len();
        let mut dense = DMatrix::zeros(len, len);
        for row in 0..matrix.len() {
            for (column, block) in matrix.row(row) {
                dense.fixed_view_mut::<MOTIONS, MOTIONS>(MOTIONS * row, MOTIONS * column).copy_from(block);
            }
        }
        let force = DVector::from_fn(len, |i, _| (i as f64).sin());
        let (mut solution, mut rest, mut pulled) = (vec![0.0; len], vec![0.0; len], vec![0.0; len]);
        sweeps.sweep(force.as_slice(), &mut solution, &mut rest);
        sweeps.multiply(&solution, &mut pulled);
        let by_rule = &dense * DVector::from_column_slice(&solution);
        for i in 0..len {
            assert!((pulled[i] - by_rule[i]).abs() < 1e-9 * (1.0 + by_rule[i].abs()), "{i}");
            assert!((force[i] - by_rule[i] - rest[i]).abs() < 1e-9, "{i}");
        }
        // With the groups before it, and without those after it, each group is in equilibrium.
        let lower =
            dense.map_with_location(|row, column, entry| if column / MOTIONS <= row / MOTIONS { entry } else { 0.0 });
        let left = lower * DVector::from_column_slice(&solution) - force;
        assert!(left.amax() < 1e-9, "{}", left.amax());
    }
}
