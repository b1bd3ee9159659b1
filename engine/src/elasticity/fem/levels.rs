//! The preconditioner: levels of groups that move as rigid bodies, each a smaller set of equations.
//!
//! Single nodes spread a load slowly and hardly resolve the bending of long thin parts, but the joint motion of
//! neighbouring nodes is nearly rigid. So each level smooths its equations, and solves those of its groups' rigid motions:
//! directly where that is little work, otherwise by the next level.

use nalgebra::Vector3;

use super::block_matrix::BlockMatrix;
use super::factor::Factor;
use super::motions::{MOTIONS, Motions};
use super::partition::Partition;
use super::smoothing::Smoothing;
use super::sweeps::Sweeps;
use super::system::System;
use super::vectors::{add, dot};
use crate::elasticity::{Control, Stopped};

/// Work of a direct solution for each block of the structure, in multiply-adds. More would cost more than it saves.
const MOST_WORK: usize = 5_000;
/// Nodes for each block below which a structure is taken to be solid: boxes of it are as good as rigid.
const SOLID: f64 = 1.5;
/// Least edge of a box of a solid structure, in blocks.
const LEAST_EDGE: f64 = 4.0;
/// Greatest number of steps of a nested solution.
const MOST_STEPS: usize = 5;
/// Part of the force that a nested solution may leave.
const ENOUGH: f64 = 0.25;

/// Approximate solution of a system, as a preconditioner.
#[derive(Debug)]
pub struct Levels {
    smoothing: Smoothing,
    /// Whether the structure is solid: the large groups then leave little for which a second smoothing pays.
    is_solid: bool,
    motions: Motions<3>,
    coarse: Coarse,
    /// What a step leaves of the residual.
    rest: Vec<f64>,
}

/// Solution of the equations among groups.
#[derive(Debug)]
enum Coarse {
    Direct(Factor),
    Nested(Box<Nested>),
}

/// Equations among groups that are solved approximately, by way of groups of groups.
#[derive(Debug)]
struct Nested {
    sweeps: Sweeps,
    motions: Motions<MOTIONS>,
    coarse: Coarse,
}

impl Levels {
    /// Sets up the levels of a system.
    ///
    /// # Errors
    /// Returns an error if `control` stops the computation; it is polled between the parts.
    pub fn new(system: &System<'_>, control: &Control<'_>) -> Result<Self, Stopped> {
        let partition = Partition::of_nodes(system);
        control.check(0.0)?;
        let position: Vec<Vector3<f64>> =
            system.mesh.position.iter().map(|position| Vector3::from(position.map(f64::from))).collect();
        let motions = Motions::new(partition, &position);
        let matrix = BlockMatrix::of_system(system, &motions);
        control.check(0.0)?;
        let blocks = system.mesh.nodes.len();
        let is_solid = (system.mesh.position.len() as f64) < SOLID * blocks as f64;
        let (motions, coarse) = if is_solid {
            in_boxes(&matrix, motions, MOST_WORK * blocks, control)?
        } else {
            let coarse = Coarse::new(matrix, &motions.middle, MOST_WORK * blocks, control)?;
            (motions, coarse)
        };
        Ok(Self { smoothing: Smoothing::new(system), is_solid, motions, coarse, rest: vec![0.0; system.len()] })
    }

    /// Returns the displacements with which a solution for `force` begins, if groups are solved for directly: those of
    /// their rigid motions. The steps by [`Levels::step`] then need not find them.
    #[must_use]
    pub fn first(&self, force: &[f64]) -> Option<Vec<f64>> {
        let Coarse::Direct(factor) = &self.coarse else { return None };
        let mut first = vec![0.0; force.len()];
        self.motions.add_to_members(&factor.solve(&self.motions.gathered(force)), &mut first);
        Some(first)
    }

    /// Computes an approximate solution for `residual`, and what it pulls.
    pub fn step(&mut self, system: &System<'_>, residual: &[f64], step: &mut [f64], pulled: &mut [f64]) {
        let Self { smoothing, motions, coarse, rest, .. } = self;
        step.fill(0.0);
        rest.copy_from_slice(residual);
        smoothing.smooth(system, rest, step);
        smoothing.finish(system, rest);
        let motion = coarse.solve(&motions.gathered(rest));
        smoothing.take(system, |moved| motions.add_to_members(&motion, moved), rest, step);
        if !self.is_solid {
            smoothing.smooth(system, rest, step);
            smoothing.finish(system, rest);
        }
        for (pulled, (residual, rest)) in pulled.iter_mut().zip(residual.iter().zip(rest.iter())) {
            *pulled = residual - rest;
        }
        system.release(pulled);
    }
}

/// Joins the groups of a solid structure in boxes that are so large that their equations can be solved directly.
fn in_boxes(
    matrix: &BlockMatrix,
    motions: Motions<3>,
    most_work: usize,
    control: &Control<'_>,
) -> Result<(Motions<3>, Coarse), Stopped> {
    let mut edge = LEAST_EDGE;
    loop {
        let boxes = Motions::new(Partition::of_boxes(matrix, &motions.middle, edge), &motions.middle);
        if let Some(factor) = Factor::within(&matrix.coarser(&boxes), most_work) {
            return Ok((motions.joined(&boxes), Coarse::Direct(factor)));
        }
        control.check(0.0)?;
        edge *= 1.5;
    }
}

impl Coarse {
    /// Prepares the solution of equations among groups with these middles.
    fn new(
        matrix: BlockMatrix,
        middle: &[Vector3<f64>],
        most_work: usize,
        control: &Control<'_>,
    ) -> Result<Self, Stopped> {
        if let Some(factor) = Factor::within(&matrix, most_work) {
            return Ok(Self::Direct(factor));
        }
        control.check(0.0)?;
        let motions = Motions::new(Partition::of_groups(&matrix), middle);
        let sweeps = Sweeps::new(&matrix);
        let coarser = matrix.coarser(&motions);
        drop(matrix);
        let coarse = Self::new(coarser, &motions.middle, most_work, control)?;
        Ok(Self::Nested(Box::new(Nested { sweeps, motions, coarse })))
    }

    fn solve(&self, force: &[f64]) -> Vec<f64> {
        match self {
            Self::Direct(factor) => factor.solve(force),
            Self::Nested(nested) => nested.solve(force),
        }
    }
}

impl Nested {
    /// Solves by a few steps of conjugate gradients (Notay 2008, the K-cycle): the number of iterations then hardly depends
    /// on the number of levels.
    fn solve(&self, force: &[f64]) -> Vec<f64> {
        let mut solution = vec![0.0; force.len()];
        let mut rest = force.to_vec();
        let enough = ENOUGH * ENOUGH * dot(force, force);
        // Directions, what they pull, and their energies.
        let mut taken: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::with_capacity(MOST_STEPS);
        while taken.len() < MOST_STEPS && (taken.is_empty() || dot(&rest, &rest) > enough) {
            let (mut direction, mut pulled) = self.step(&rest);
            for (earlier, by_earlier, energy) in &taken {
                let part = dot(&direction, by_earlier) / energy;
                add(-part, earlier, &mut direction);
                add(-part, by_earlier, &mut pulled);
            }
            let energy = dot(&direction, &pulled);
            if energy <= 0.0 {
                break;
            }
            let length = dot(&direction, &rest) / energy;
            add(length, &direction, &mut solution);
            add(-length, &pulled, &mut rest);
            taken.push((direction, pulled, energy));
        }
        solution
    }

    /// Returns a step and what it pulls.
    fn step(&self, residual: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let zeros = || vec![0.0; self.sweeps.len()];
        let (mut step, mut rest, mut moved, mut pulled) = (zeros(), zeros(), zeros(), zeros());
        self.sweeps.sweep(residual, &mut step, &mut rest);
        self.motions.add_to_members(&self.coarse.solve(&self.motions.gathered(&rest)), &mut moved);
        self.sweeps.multiply(&moved, &mut pulled);
        add(1.0, &moved, &mut step);
        add(-1.0, &rest, &mut pulled);
        add(1.0, residual, &mut pulled);
        (step, pulled)
    }
}
