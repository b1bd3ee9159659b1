//! Smoothing: exact solutions of each group's own equations, with all other groups held.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::collections::HashMap;

use foldhash::fast::FixedState;
use pulp::{Arch, Simd, WithSimd};

use super::block_matrix::BlockMatrix;
use super::motions::MOTIONS;
use super::partition::Partition;
use super::system::System;
use crate::elasticity::lanes::Lanes;

/// Rows of a stored matrix are a multiple of this long, which is a multiple of the lanes of every processor.
const ROW: usize = 8;
/// Number of members of most groups of a solid structure, which are compared for equal equations.
const CUBE: usize = 8;
/// Number of vectors of rows that are computed at the same time, so that none waits for another.
const TOGETHER: usize = 6;

/// Inverses of the groups' own equations.
#[derive(Debug)]
pub struct Local {
    /// Members of all groups, group by group.
    members: Vec<u32>,
    /// Number of members of each group.
    sizes: Vec<u32>,
    /// Where the inverse of each group begins. Groups with equal equations, of which a solid structure has many, share one.
    start: Vec<usize>,
    /// Distinct inverses, one after the other, each row padded with zeros.
    inverses: Vec<f64>,
    /// Number of unknowns of a member.
    unknowns: usize,
    arch: Arch,
}

impl Local {
    /// Inverts the equations of groups of nodes.
    #[must_use]
    pub fn of_nodes(system: &System<'_>, partition: &Partition) -> Self {
        let members = partition.members();
        let mut around = vec![Vec::new(); members.len()];
        for (block, nodes) in (0u32..).zip(&system.mesh.nodes) {
            let mut groups: Vec<u32> = nodes.iter().filter_map(|&node| partition.group[node as usize]).collect();
            groups.sort_unstable();
            groups.dedup();
            for group in groups {
                around[group as usize].push(block);
            }
        }
        Self::new(&members, 3, |group, index, add| {
            for &block in &around[group] {
                let nodes = &system.mesh.nodes[block as usize];
                let own =
                    |node: u32| (partition.group[node as usize] == Some(group as u32)).then(|| index[node as usize]);
                for (i, row) in nodes.iter().enumerate().filter_map(|(i, &node)| Some((i, own(node)?))) {
                    for (j, column) in nodes.iter().enumerate().filter_map(|(j, &node)| Some((j, own(node)?))) {
                        for (k, l) in (0..3).flat_map(|k| (0..3).map(move |l| (k, l))) {
                            let entry = system.element.stiffness[(3 * i + k, 3 * j + l)] * system.edge_m;
                            add(3 * row + k, 3 * column + l, entry);
                        }
                    }
                }
            }
        })
    }

    /// Inverts the equations of groups of groups.
    #[must_use]
    pub fn of_groups(matrix: &BlockMatrix, partition: &Partition) -> Self {
        let members = partition.members();
        Self::new(&members, MOTIONS, |group, index, add| {
            for &member in &members[group] {
                for (neighbour, block) in matrix.row(member as usize) {
                    if partition.group[neighbour] == Some(group as u32) {
                        let (row, column) = (index[member as usize], index[neighbour]);
                        for (k, l) in (0..MOTIONS).flat_map(|k| (0..MOTIONS).map(move |l| (k, l))) {
                            add(MOTIONS * row + k, MOTIONS * column + l, block[(k, l)]);
                        }
                    }
                }
            }
        })
    }

    /// Inverts the equations of groups. `assemble` receives a group, the index of each member in its group, and what adds
    /// an entry at a row and a column.
    fn new(
        members: &[Vec<u32>],
        unknowns: usize,
        assemble: impl Fn(usize, &[usize], &mut dyn FnMut(usize, usize, f64)),
    ) -> Self {
        let most = members.iter().flatten().max().map_or(0, |most| *most as usize + 1);
        let mut index = vec![0; most];
        for members in members {
            for (place, &member) in members.iter().enumerate() {
                index[member as usize] = place;
            }
        }
        let arch = Arch::new();
        let mut known: HashMap<Vec<u64>, usize, FixedState> = HashMap::default();
        let mut inverses: Vec<f64> = Vec::new();
        let start = members.iter().enumerate().map(|(group, members)| {
            let rows = members.len() * unknowns;
            let len = rows.next_multiple_of(ROW);
            let mut matrix = vec![0.0; rows * len];
            assemble(group, &index, &mut |row, column, entry| matrix[row * len + column] += entry);
            let is_cube = members.len() == CUBE;
            let key: Vec<u64> = matrix.iter().filter(|_| is_cube).map(|entry| entry.to_bits()).collect();
            if let Some(start) = known.get(&key) {
                return *start;
            }
            arch.dispatch(Invert { matrix: &mut matrix, rows });
            let start = inverses.len();
            inverses.extend(matrix);
            if is_cube {
                known.insert(key, start);
            }
            start
        });
        let start = start.collect();
        let sizes = members.iter().map(|members| members.len() as u32).collect();
        Self { members: members.concat(), sizes, start, inverses, unknowns, arch }
    }

    /// Adds `weight` times each group's own solution for `force` to `to`.
    pub fn add_solution(&self, weight: f64, force: &[f64], to: &mut [f64]) {
        self.arch.dispatch(AddSolution { local: self, weight, force, to });
    }
}

/// Operation that inverts a symmetric positive definite matrix in place, column by column. A pivot that is nothing beside
/// its diagonal leaves the unknown out.
struct Invert<'a> {
    matrix: &'a mut [f64],
    rows: usize,
}

impl WithSimd for Invert<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const DEPENDENT: f64 = 1e-12;
        let Self { matrix, rows } = self;
        let len = rows.next_multiple_of(ROW);
        let scale: Vec<f64> = (0..rows).map(|i| matrix[i * len + i]).collect();
        let mut pivots = vec![0.0; len];
        for k in 0..rows {
            pivots.copy_from_slice(&matrix[k * len..][..len]);
            let pivot = pivots[k];
            if pivot <= DEPENDENT * scale[k] {
                for i in 0..rows {
                    matrix[k * len + i] = 0.0;
                    matrix[i * len + k] = 0.0;
                }
                continue;
            }
            pivots[k] = 1.0;
            for entry in &mut pivots {
                *entry /= pivot;
            }
            for (i, row) in matrix.chunks_exact_mut(len).enumerate() {
                if i == k {
                    row.copy_from_slice(&pivots);
                    continue;
                }
                let factor = Lanes::splat(simd, row[k]);
                row[k] = 0.0;
                for at in (0..len).step_by(S::F64_LANES) {
                    let entry = Lanes::load(simd, row, at);
                    Lanes::load(simd, &pivots, at).subtract_product_from(factor, entry).store(row, at);
                }
            }
        }
    }
}

/// Operation that solves all groups' own equations.
struct AddSolution<'a> {
    local: &'a Local,
    weight: f64,
    force: &'a [f64],
    to: &'a mut [f64],
}

impl WithSimd for AddSolution<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let unknowns = self.local.unknowns;
        let mut members = self.local.members.as_slice();
        let most = self.local.sizes.iter().copied().max().unwrap_or(0) as usize * unknowns;
        let mut force = Vec::with_capacity(most);
        let mut own = vec![0.0; most.next_multiple_of(ROW)];
        for (&size, &start) in self.local.sizes.iter().zip(&self.local.start) {
            let (of_group, rest) = members.split_at(size as usize);
            members = rest;
            force.clear();
            for &member in of_group {
                force.extend_from_slice(&self.force[unknowns * member as usize..][..unknowns]);
            }
            // The matrix is symmetric, so its rows are its columns.
            let len = force.len().next_multiple_of(ROW);
            let columns = &self.local.inverses[start..start + force.len() * len];
            let mut row = 0;
            while row < len {
                let vectors = ((len - row) / S::F64_LANES).min(TOGETHER);
                match vectors {
                    1 => multiply::<S, 1>(simd, columns, &force, row, &mut own),
                    2 => multiply::<S, 2>(simd, columns, &force, row, &mut own),
                    3 => multiply::<S, 3>(simd, columns, &force, row, &mut own),
                    4 => multiply::<S, 4>(simd, columns, &force, row, &mut own),
                    5 => multiply::<S, 5>(simd, columns, &force, row, &mut own),
                    _ => multiply::<S, TOGETHER>(simd, columns, &force, row, &mut own),
                }
                row += vectors * S::F64_LANES;
            }
            for (member, own) in of_group.iter().zip(own.chunks_exact(unknowns)) {
                let to = &mut self.to[unknowns * *member as usize..][..unknowns];
                for (to, own) in to.iter_mut().zip(own) {
                    *to += self.weight * own;
                }
            }
        }
    }
}

/// Computes `N` vectors of rows, from `row` on, of the product of a matrix and a vector.
#[inline(always)]
fn multiply<S: Simd, const N: usize>(simd: S, columns: &[f64], vector: &[f64], row: usize, product: &mut [f64]) {
    let len = vector.len().next_multiple_of(ROW);
    let mut sums = [Lanes::splat(simd, 0.0); N];
    for (factor, column) in vector.iter().zip(columns.chunks_exact(len)) {
        let factor = Lanes::splat(simd, *factor);
        for k in 0..N {
            sums[k] = Lanes::load(simd, column, row + k * S::F64_LANES).mul_add(factor, sums[k]);
        }
    }
    for k in 0..N {
        sums[k].store(product, row + k * S::F64_LANES);
    }
}
