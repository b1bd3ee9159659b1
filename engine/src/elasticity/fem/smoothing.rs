//! Smoothing of the equations of all nodes: a polynomial of them, which takes away what a few blocks resist.

use super::motions::Motions;
use super::pipeline::Open;
use super::steps::{Step, Vectors};
use super::system::System;
use crate::elasticity::Control;

/// Degree of the polynomial.
const DEGREE: usize = 3;
/// Ratio of the greatest eigenvalue to the least whose part of an error the polynomial reduces; groups reduce the others.
const RATIO: f64 = 20.0;

/// Smoothing by Chebyshev's polynomial, with each equation divided by its diagonal (Adams et al. 2003).
#[derive(Debug)]
pub struct Smoothing {
    /// Reciprocal of each unknown's entry on the diagonal, m/N; zero for a held node.
    compliance: Vec<f64>,
    /// Factor of a force divided by the diagonal in the first step of the polynomial.
    of_force: f64,
    /// Steps of the polynomial after the first.
    next: [Step; DEGREE - 1],
    /// Last step.
    direction: Vec<f64>,
    open: Open,
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
        let greatest = system.element.greatest;
        let least = greatest / RATIO;
        let (middle, half) = (f64::midpoint(greatest, least), (greatest - least) / 2.0);
        let mut recurrence = half / middle;
        Self {
            compliance: blocks.into_iter().zip(&system.is_held).map(compliance).flat_map(|node| [node; 3]).collect(),
            of_force: 1.0 / middle,
            next: std::array::from_fn(|_| {
                let next = 1.0 / (2.0 * middle / half - recurrence);
                let step = Step::Next { of_direction: next * recurrence, of_rest: 2.0 * next / half };
                recurrence = next;
                step
            }),
            direction: vec![0.0; system.len()],
            open: Open::new(&system.shares),
        }
    }

    /// Smooths from a solution of zero for `force`: writes the sum of the steps to `solution`, and to `rest` the force that
    /// they leave. `pulled` stays as it is.
    pub fn begin(
        &mut self,
        system: &System<'_>,
        control: &Control<'_>,
        force: &[f64],
        rest: &mut [f64],
        solution: &mut [f64],
        pulled: &mut [f64],
    ) {
        let Self { compliance, direction, open, of_force, next: [second, third] } = self;
        let vectors = Vectors { force, compliance, direction, rest, solution, pulled };
        let steps = [*second, *third, Step::Settle];
        system.pipeline().take(control, &steps, open, vectors, &|_, vectors| {
            let Vectors { force, compliance, direction, rest, solution, .. } = vectors;
            rest.copy_from_slice(force);
            for ((direction, compliance), force) in direction.iter_mut().zip(compliance).zip(force) {
                *direction = *of_force * compliance * force;
            }
            solution.copy_from_slice(direction);
        });
    }

    /// Adds to `solution` the motions of groups, and then, if `smooths`, steps that smooth the error. Writes to `pulled`
    /// what all steps for `force` pull, zero on held nodes, if `rest` holds what those before have left.
    pub fn end(
        &mut self,
        system: &System<'_>,
        control: &Control<'_>,
        (motions, motion): (&Motions<3>, &[f64]),
        smooths: bool,
        vectors: (&[f64], &mut [f64], &mut [f64], &mut [f64]),
    ) {
        let (force, rest, solution, pulled) = vectors;
        let Self { compliance, direction, open, of_force, next: [second, third] } = self;
        let vectors = Vectors { force, compliance, direction, rest, solution, pulled };
        let steps = [Step::First { of_rest: *of_force }, *second, *third, Step::End { adds: false }];
        let steps = if smooths { &steps[..] } else { &[Step::End { adds: true }] };
        system.pipeline().take(control, steps, open, vectors, &|nodes, vectors| {
            motions.move_members(motion, nodes, vectors.direction);
        });
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
        let (mut rest, mut solution, mut pulled) = (force.clone(), force.clone(), force.clone());
        let mut smoothing = Smoothing::new(&system);
        smoothing.begin(&system, &Control::unhurried(), &force, &mut rest, &mut solution, &mut pulled);
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
