//! Equations among groups: a symmetric sparse matrix of blocks, one for each pair of groups that are tied.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::motions::{MOTIONS, Motions};
use super::system::System;

/// Stiffness among the rigid motions of groups. Rows have their columns ascending, the diagonal among them.
#[derive(Debug)]
pub struct BlockMatrix {
    /// First entry of each row, and the number of entries.
    start: Vec<usize>,
    column: Vec<u32>,
    block: Vec<Matrix6<f64>>,
}

impl BlockMatrix {
    /// Returns the stiffness of a system for the rigid motions of groups of its nodes.
    #[must_use]
    pub fn of_system(system: &System<'_>, motions: &Motions<3>) -> Self {
        let mut tied = vec![Vec::new(); motions.middle.len()];
        for nodes in &system.mesh.nodes {
            let groups = nodes.map(|node| motions.group[node as usize]);
            for a in groups.iter().flatten() {
                for b in groups.iter().flatten() {
                    add_once(&mut tied[*a as usize], *b);
                }
            }
        }
        let mut matrix = Self::with_entries(tied);
        let corner = |i: usize, j: usize| -> Matrix3<f64> {
            system.element.stiffness.fixed_view::<3, 3>(3 * i, 3 * j) * system.edge_m
        };
        let pairs: [[Matrix3<f64>; 8]; 8] = std::array::from_fn(|i| std::array::from_fn(|j| corner(i, j)));
        for nodes in &system.mesh.nodes {
            let groups = nodes.map(|node| motions.group[node as usize]);
            // A block within one group does not resist its rigid motions.
            if groups[0].is_some() && groups.iter().all(|group| *group == groups[0]) {
                continue;
            }
            let arms = nodes.map(|node| turning(&motions.arm[node as usize]));
            for (i, a) in groups.iter().enumerate() {
                let Some(a) = *a else { continue };
                for (j, b) in groups.iter().enumerate() {
                    let Some(b) = *b else { continue };
                    let block = matrix.entry(a, b);
                    let stiffness = &pairs[i][j];
                    let turned = stiffness * arms[j];
                    let transposed = arms[i].transpose();
                    add(block, 0, 0, stiffness);
                    add(block, 0, 3, &turned);
                    add(block, 3, 0, &(transposed * stiffness));
                    add(block, 3, 3, &(transposed * turned));
                }
            }
        }
        matrix
    }

    /// Returns this stiffness for the rigid motions of groups of its groups.
    #[must_use]
    pub fn coarser(&self, motions: &Motions<MOTIONS>) -> Self {
        let group = |member: usize| motions.group[member].expect("every group is a member of a coarser one");
        let mut tied = vec![Vec::new(); motions.middle.len()];
        for member in 0..self.len() {
            for (neighbour, _) in self.row(member) {
                add_once(&mut tied[group(member) as usize], group(neighbour));
            }
        }
        let mut matrix = Self::with_entries(tied);
        let moved = motions.arm.iter().map(|arm| {
            let mut moved = Matrix6::identity();
            moved.fixed_view_mut::<3, 3>(0, 3).copy_from(&turning(arm));
            moved
        });
        let moved: Vec<Matrix6<f64>> = moved.collect();
        for member in 0..self.len() {
            for (neighbour, block) in self.row(member) {
                *matrix.entry(group(member), group(neighbour)) +=
                    moved[member].transpose() * (block * moved[neighbour]);
            }
        }
        matrix
    }

    fn with_entries(tied: Vec<Vec<u32>>) -> Self {
        let mut matrix = Self { start: vec![0], column: Vec::new(), block: Vec::new() };
        for mut columns in tied {
            columns.sort_unstable();
            matrix.column.extend(columns);
            matrix.start.push(matrix.column.len());
        }
        matrix.block = vec![Matrix6::zeros(); matrix.column.len()];
        matrix
    }

    fn entry(&mut self, row: u32, column: u32) -> &mut Matrix6<f64> {
        let range = self.start[row as usize]..self.start[row as usize + 1];
        let at = self.column[range.clone()].binary_search(&column).expect("tied groups have an entry");
        &mut self.block[range.start + at]
    }

    /// Returns the number of rows of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Returns the columns and blocks of a row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &Matrix6<f64>)> {
        let range = self.start[row]..self.start[row + 1];
        self.column[range.clone()].iter().map(|&column| column as usize).zip(&self.block[range])
    }
}

/// Returns the matrix that takes a rotation `w` to the displacement `w x arm`.
fn turning(arm: &Vector3<f64>) -> Matrix3<f64> {
    arm.cross_matrix().transpose()
}

fn add(block: &mut Matrix6<f64>, row: usize, column: usize, part: &Matrix3<f64>) {
    let mut view = block.fixed_view_mut::<3, 3>(row, column);
    view += part;
}

fn add_once(columns: &mut Vec<u32>, column: u32) {
    if !columns.contains(&column) {
        columns.push(column);
    }
}
