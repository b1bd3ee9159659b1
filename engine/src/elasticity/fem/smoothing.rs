//! Smoothing of the equations of all nodes: a polynomial of them, which takes away what a few blocks resist.

use super::system::System;
use super::vectors::add;

/// Degree of the polynomial.
const DEGREE: usize = 3;
/// Ratio of the greatest eigenvalue to the least whose part of an error the polynomial reduces; groups reduce the others.
const RATIO: f64 = 20.0;

/// Smoothing by Chebyshev's polynomial, with each equation divided by its diagonal (Adams et al. 2003).
#[derive(Debug)]
pub struct Smoothing {
    /// Reciprocal of each unknown's entry on the diagonal, m/N; zero for a held node.
    compliance: Vec<f64>,
    /// Bound on the eigenvalues of the divided equations.
    greatest: f64,
    /// Direction of the last step.
    direction: Vec<f64>,
    pulled: Vec<f64>,
}

impl Smoothing {
    /// Prepares the smoothing of a system.
    #[must_use]
    pub fn new(system: &System<'_>) -> Self {
        let mut blocks = vec![0.0; system.mesh.position.len()];
        for &node in system.mesh.nodes.iter().flatten() {
            blocks[node as usize] += 1.0;
        }
        let of_block = system.element.stiffness[(0, 0)] * system.edge_m;
        let compliance = |(blocks, is_held): (f64, &bool)| if *is_held { 0.0 } else { 1.0 / (blocks * of_block) };
        Self {
            compliance: blocks.into_iter().zip(&system.is_held).map(compliance).flat_map(|node| [node; 3]).collect(),
            greatest: system.element.greatest,
            direction: vec![0.0; system.len()],
            pulled: vec![0.0; system.len()],
        }
    }

    /// Adds to `solution` steps that smooth its error, and subtracts from `rest`, the force that it leaves, what all but the
    /// last of them pull.
    pub fn smooth(&mut self, system: &System<'_>, rest: &mut [f64], solution: &mut [f64]) {
        let least = self.greatest / RATIO;
        let (middle, half) = (f64::midpoint(self.greatest, least), (self.greatest - least) / 2.0);
        let unknowns = self.direction.iter_mut().zip(&*rest).zip(&self.compliance).zip(&mut *solution);
        for (((direction, rest), compliance), solution) in unknowns {
            *direction = compliance / middle * rest;
            *solution += *direction;
        }
        let mut recurrence = half / middle;
        for _ in 1..DEGREE {
            system.pull(&self.direction, &mut self.pulled);
            let next = 1.0 / (2.0 * middle / half - recurrence);
            let (of_direction, of_rest) = (next * recurrence, 2.0 * next / half);
            let unknowns = self.direction.iter_mut().zip(&mut *rest).zip(&self.compliance);
            let unknowns = unknowns.zip(&mut *solution).zip(&self.pulled);
            for ((((direction, rest), compliance), solution), pulled) in unknowns {
                *rest -= pulled;
                *direction = of_direction * *direction + of_rest * compliance * *rest;
                *solution += *direction;
            }
            recurrence = next;
        }
    }

    /// Subtracts from `rest` what the last step pulls.
    pub fn finish(&mut self, system: &System<'_>, rest: &mut [f64]) {
        system.pull(&self.direction, &mut self.pulled);
        add(-1.0, &self.pulled, rest);
    }

    /// Takes a step that `moves` writes: adds it to `solution`, and subtracts from `rest` what it pulls.
    pub fn take(
        &mut self,
        system: &System<'_>,
        moves: impl FnOnce(&mut [f64]),
        rest: &mut [f64],
        solution: &mut [f64],
    ) {
        self.direction.fill(0.0);
        moves(&mut self.direction);
        add(1.0, &self.direction, solution);
        self.finish(system, rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elasticity::fem::ELEMENT;
    use crate::elasticity::fem::element::UNKNOWNS;
    use crate::elasticity::fem::mesh::Mesh;
    use crate::voxel::Cell;

    #[test]
    fn the_diagonal_of_a_block_is_one_number() {
        let stiffness = &ELEMENT.stiffness;
        assert!((0..UNKNOWNS).all(|i| (stiffness[(i, i)] / stiffness[(0, 0)] - 1.0).abs() < 1e-12));
    }

    #[test]
    fn smoothing_reduces_rough_errors() {
        let mesh = Mesh::new((0..6 * 6 * 6).map(|i| Cell::new(i % 6, i / 6 % 6, i / 36)).collect());
        let system = System::new(&mesh, &ELEMENT, 1.0, |position| position[1] == 0);
        // Displacements that change their sign from node to node.
        let rough = mesh.position.iter().flat_map(|p| [if p.iter().sum::<i32>() % 2 == 0 { 1.0 } else { -1.0 }; 3]);
        let mut rough: Vec<f64> = rough.collect();
        system.release(&mut rough);
        let mut force = vec![0.0; system.len()];
        system.apply(&rough, &mut force);
        let (mut rest, mut solution, mut pulled) = (force.clone(), vec![0.0; system.len()], force.clone());
        let mut smoothing = Smoothing::new(&system);
        smoothing.smooth(&system, &mut rest, &mut solution);
        smoothing.finish(&system, &mut rest);
        system.release(&mut rest);
        system.apply(&solution, &mut pulled);
        let greatest = force.iter().copied().fold(0.0, f64::max);
        for ((force, pulled), rest) in force.iter().zip(&pulled).zip(&rest) {
            assert!((force - pulled - rest).abs() < 1e-9 * greatest);
        }
        let error: Vec<f64> = rough.iter().zip(&solution).map(|(rough, solution)| rough - solution).collect();
        let norm = |vector: &[f64]| vector.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
        // The polynomial is at most 1 / T3(21 / 19) in its range.
        assert!(norm(&error) < 0.48 * norm(&rough), "{} of {}", norm(&error), norm(&rough));
    }
}
