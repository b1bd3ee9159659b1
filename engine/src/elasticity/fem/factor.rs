//! Direct solution of the equations among groups: a sparse Cholesky factorisation by blocks.

use std::collections::BTreeSet;

use nalgebra::Matrix6;

use super::block_matrix::BlockMatrix;
use super::motions::MOTIONS;
use super::root::Root;

/// Lower triangular factor, by columns, of a matrix in the order in which its groups are eliminated.
#[derive(Debug)]
pub struct Factor {
    /// Group at each place of the order.
    order: Vec<u32>,
    /// Rows below the diagonal of each column, as places of the order, ascending.
    rows: Vec<Vec<u32>>,
    diagonal: Vec<Root>,
    below: Vec<Vec<Matrix6<f64>>>,
}

impl Factor {
    /// Factorises a matrix if that takes at most `most_work` multiply-adds.
    #[must_use]
    pub fn within(matrix: &BlockMatrix, most_work: usize) -> Option<Self> {
        let (order, rows) = least_fill(matrix, most_work)?;
        Some(Self::new(matrix, order, rows))
    }

    fn new(matrix: &BlockMatrix, order: Vec<u32>, rows: Vec<Vec<u32>>) -> Self {
        let groups = order.len();
        let mut place = vec![0; groups];
        for (at, &group) in order.iter().enumerate() {
            place[group as usize] = at;
        }
        let mut factor = Self { order, rows, diagonal: Vec::with_capacity(groups), below: Vec::with_capacity(groups) };
        // Columns whose next row is the one that is computed, each with the index of that row.
        let mut due: Vec<Vec<(u32, u32)>> = vec![Vec::new(); groups];
        let mut slot = vec![u32::MAX; groups];
        for column in 0..groups {
            let rows = &factor.rows[column];
            for (at, &row) in (0..).zip(rows) {
                slot[row as usize] = at;
            }
            let mut diagonal = Matrix6::zeros();
            let mut below = vec![Matrix6::zeros(); rows.len()];
            for (neighbour, block) in matrix.row(factor.order[column] as usize) {
                // The matrix is symmetric; what is read as a row is stored as a column.
                if place[neighbour] == column {
                    diagonal = *block;
                } else if place[neighbour] > column {
                    below[slot[place[neighbour]] as usize] = block.transpose();
                }
            }
            let scale = diagonal.diagonal();
            for (earlier, at) in std::mem::take(&mut due[column]) {
                let (blocks, of_rows) = (&factor.below[earlier as usize], &factor.rows[earlier as usize]);
                let own = blocks[at as usize].transpose();
                diagonal -= blocks[at as usize] * own;
                for (block, &row) in blocks.iter().zip(of_rows).skip(at as usize + 1) {
                    below[slot[row as usize] as usize] -= block * own;
                }
                if let Some(&next) = of_rows.get(at as usize + 1) {
                    due[next as usize].push((earlier, at + 1));
                }
            }
            let diagonal = Root::new(&diagonal, &scale);
            for block in &mut below {
                diagonal.divide(block);
            }
            if let Some(&next) = rows.first() {
                due[next as usize].push((column as u32, 0));
            }
            factor.diagonal.push(diagonal);
            factor.below.push(below);
        }
        factor
    }

    /// Solves the equations.
    #[must_use]
    pub fn solve(&self, force: &[f64]) -> Vec<f64> {
        let part =
            |vector: &[f64], place: usize| -> [f64; MOTIONS] { std::array::from_fn(|k| vector[MOTIONS * place + k]) };
        let mut motion = Vec::with_capacity(force.len());
        for &group in &self.order {
            motion.extend(part(force, group as usize));
        }
        for (column, diagonal) in self.diagonal.iter().enumerate() {
            let mut own = part(&motion, column);
            diagonal.solve_forward(&mut own);
            motion[MOTIONS * column..][..MOTIONS].copy_from_slice(&own);
            for (&row, block) in self.rows[column].iter().zip(&self.below[column]) {
                let to = &mut motion[MOTIONS * row as usize..][..MOTIONS];
                for (entries, factor) in block.as_slice().chunks_exact(MOTIONS).zip(&own) {
                    for (to, entry) in to.iter_mut().zip(entries) {
                        *to -= entry * factor;
                    }
                }
            }
        }
        for (column, diagonal) in self.diagonal.iter().enumerate().rev() {
            let mut own = part(&motion, column);
            for (&row, block) in self.rows[column].iter().zip(&self.below[column]) {
                let from = part(&motion, row as usize);
                for (own, entries) in own.iter_mut().zip(block.as_slice().chunks_exact(MOTIONS)) {
                    *own -= entries.iter().zip(&from).map(|(entry, from)| entry * from).sum::<f64>();
                }
            }
            diagonal.solve_backward(&mut own);
            motion[MOTIONS * column..][..MOTIONS].copy_from_slice(&own);
        }
        let mut solved = vec![0.0; force.len()];
        for (place, &group) in self.order.iter().enumerate() {
            solved[MOTIONS * group as usize..][..MOTIONS].copy_from_slice(&part(&motion, place));
        }
        solved
    }
}

/// Returns the order of elimination, and the rows of each column of the factor as places of that order; `None` if the
/// factorisation takes more work. Each step eliminates a group with few neighbours, which become neighbours of each
/// other.
fn least_fill(matrix: &BlockMatrix, most_work: usize) -> Option<(Vec<u32>, Vec<Vec<u32>>)> {
    let groups = matrix.len();
    let others = |row| matrix.row(row).map(|(column, _)| column as u32).filter(move |&column| column as usize != row);
    // Neighbours by entries of the matrix, and by eliminated groups, whose neighbours are neighbours of each other.
    let mut direct: Vec<Vec<u32>> = (0..groups).map(|row| others(row).collect()).collect();
    let mut through: Vec<Vec<u32>> = vec![Vec::new(); groups];
    let mut reached: Vec<Vec<u32>> = vec![Vec::new(); groups];
    let mut rows: Vec<Vec<u32>> = vec![Vec::new(); groups];
    // An upper bound on the number of neighbours; counting them exactly would take longer than the rest.
    let mut bound: Vec<usize> = direct.iter().map(Vec::len).collect();
    let mut queue: BTreeSet<(usize, u32)> = bound.iter().copied().zip(0..).collect();
    let mut seen_by = vec![None; groups];
    let mut order = Vec::with_capacity(groups);
    let mut work = 0;
    while let Some((_, group)) = queue.pop_first() {
        let own = group as usize;
        seen_by[own] = Some(group);
        let passed = std::mem::take(&mut through[own]);
        let mut near = std::mem::take(&mut direct[own]);
        near.extend(passed.iter().flat_map(|&via| std::mem::take(&mut reached[via as usize])));
        near.retain(|&other| seen_by[other as usize].replace(group) != Some(group));
        work += (near.len() + 1).pow(2) * MOTIONS.pow(3) / 2;
        if work > most_work {
            return None;
        }
        reached[own].clone_from(&near);
        for &other in &near {
            let at = other as usize;
            direct[at].retain(|&next| seen_by[next as usize] != Some(group));
            through[at].retain(|via| !passed.contains(via));
            through[at].push(group);
            queue.remove(&(bound[at], other));
            let beyond: usize = through[at].iter().map(|&via| reached[via as usize].len()).sum();
            bound[at] = direct[at].len() + beyond;
            queue.insert((bound[at], other));
        }
        order.push(group);
        rows[own] = near;
    }
    let mut place = vec![0; groups];
    for (at, &group) in (0..).zip(&order) {
        place[group as usize] = at;
    }
    let placed = |&group: &u32| {
        let mut rows: Vec<u32> = rows[group as usize].iter().map(|&row| place[row as usize]).collect();
        rows.sort_unstable();
        rows
    };
    Some((order.clone(), order.iter().map(placed).collect()))
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

    /// A frame of two storeys, whose groups are tied in rings.
    fn frame() -> Mesh {
        let is_taken = |x: i32, y: i32, z: i32| match y % 5 {
            4 => x % 6 == 0 || z % 6 == 0,
            _ => x % 6 == 0 && z % 6 == 0,
        };
        let cells = (0..7 * 10 * 7).map(|i| Cell::new(i % 7, i / 7 % 10, i / 70));
        Mesh::new(cells.filter(|cell| is_taken(cell.x, cell.y, cell.z)).collect())
    }

    fn equations(mesh: &Mesh) -> BlockMatrix {
        let system = System::new(mesh, &ELEMENT, 1.0, |position| position[1] == 0);
        let position: Vec<_> = mesh.position.iter().map(|position| position.map(f64::from).into()).collect();
        BlockMatrix::of_system(&system, &Motions::new(Partition::of_nodes(&system), &position))
    }

    #[test]
    fn the_factor_solves_what_it_is_made_of() {
        let matrix = equations(&frame());
        let factor = Factor::within(&matrix, usize::MAX).expect("the work is not limited");
        let expected = DVector::from_fn(MOTIONS * matrix.len(), |i, _| (i as f64).sin());
        let mut dense = DMatrix::zeros(expected.len(), expected.len());
        for row in 0..matrix.len() {
            for (column, block) in matrix.row(row) {
                dense.fixed_view_mut::<MOTIONS, MOTIONS>(MOTIONS * row, MOTIONS * column).copy_from(block);
            }
        }
        let force = &dense * &expected;
        let by_rule = dense.cholesky().expect("the frame is held").solve(&force);
        for ((found, by_rule), expected) in factor.solve(force.as_slice()).iter().zip(by_rule.iter()).zip(&expected) {
            assert!((found - by_rule).abs() < 1e-6 && (found - expected).abs() < 1e-6, "{found}, expected {expected}");
        }
    }

    #[test]
    fn more_work_than_allowed_is_refused() {
        assert!(Factor::within(&equations(&frame()), 1_000).is_none());
    }
}
