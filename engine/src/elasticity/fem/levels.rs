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
use super::vectors::{add, dot, in_strips};
use crate::elasticity::{Control, Stopped};

/// Work of a direct solution for each block of the structure, in multiply-adds. More would cost more than it saves.
const MAX_WORK: usize = 5_000;
/// Nodes for each block below which a structure is taken to be solid: boxes of it are as good as rigid.
const SOLID: f64 = 1.5;
/// Least edge of a box of a solid structure, in blocks.
const LEAST_EDGE: f64 = 4.0;
/// Greatest number of steps of a nested solution.
const MAX_STEPS: usize = 5;
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
    /// Motions of the members by those of their groups.
    moved: Vec<f64>,
    /// What a step leaves of a force.
    rest: Vec<f64>,
    /// Steps that are taken.
    taken: Vec<Taken>,
}

/// Step of a nested solution.
#[derive(Debug)]
struct Taken {
    step: Vec<f64>,
    /// What the step pulls.
    pulled: Vec<f64>,
    energy: f64,
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
            in_boxes(&matrix, motions, MAX_WORK * blocks, control)?
        } else {
            let coarse = Coarse::new(matrix, &motions.middle, MAX_WORK * blocks, control)?;
            (motions, coarse)
        };
        Ok(Self { smoothing: Smoothing::new(system), is_solid, motions, coarse, rest: vec![0.0; system.len()] })
    }

    /// Returns the displacements with which a solution for `force` begins, if groups are solved for directly: those of
    /// their rigid motions. The steps by [`Levels::step`] then need not find them.
    #[must_use]
    pub fn first(&self, force: &[f64], control: &Control<'_>) -> Option<Vec<f64>> {
        let Coarse::Direct(factor) = &self.coarse else { return None };
        let mut first = vec![0.0; force.len()];
        self.motions.move_all(control, &factor.solve(&self.motions.gathered(control, force)), &mut first);
        Some(first)
    }

    /// Computes an approximate solution for `residual`, and what it pulls.
    pub fn step(
        &mut self,
        system: &System<'_>,
        control: &Control<'_>,
        residual: &[f64],
        step: &mut [f64],
        pulled: &mut [f64],
    ) {
        let Self { smoothing, motions, coarse, rest, .. } = self;
        smoothing.begin(system, control, residual, rest, step, pulled);
        let motion = coarse.solve(control, &motions.gathered(control, rest));
        smoothing.end(system, control, (motions, &motion), !self.is_solid, (residual, rest, step, pulled));
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
        let (moved, rest) = (vec![0.0; sweeps.len()], vec![0.0; sweeps.len()]);
        Ok(Self::Nested(Box::new(Nested { sweeps, motions, coarse, moved, rest, taken: Vec::new() })))
    }

    fn solve(&mut self, control: &Control<'_>, force: &[f64]) -> Vec<f64> {
        match self {
            Self::Direct(factor) => factor.solve(force),
            Self::Nested(nested) => nested.solve(control, force),
        }
    }
}

impl Nested {
    /// Solves by a few steps of conjugate gradients (Notay 2008, the K-cycle): the number of iterations then hardly depends
    /// on the number of levels.
    fn solve(&mut self, control: &Control<'_>, force: &[f64]) -> Vec<f64> {
        let mut solution = vec![0.0; force.len()];
        let mut rest = force.to_vec();
        let mut square = dot(force, force);
        let enough = ENOUGH * ENOUGH * square;
        let mut taken = 0;
        while taken < MAX_STEPS && (taken == 0 || square > enough) {
            if self.taken.len() == taken {
                self.taken.push(Taken { step: vec![0.0; force.len()], pulled: vec![0.0; force.len()], energy: 0.0 });
            }
            self.step(control, &rest, taken);
            let (earlier, next) = self.taken.split_at_mut(taken);
            let Taken { step, pulled, energy } = &mut next[0];
            for earlier in &*earlier {
                let [common] = in_strips(control, [step, &earlier.pulled], [], |[a, b], []| [dot(a, b)]);
                let part = common / earlier.energy;
                let (read, written) = ([&*earlier.step, &earlier.pulled], [&mut **step, pulled]);
                in_strips(control, read, written, |[by_step, by_pulled], [step, pulled]| {
                    add(-part, by_step, step);
                    add(-part, by_pulled, pulled);
                    []
                });
            }
            let of_step = |[step, pulled, rest]: [&[f64]; 3], []: [&mut [f64]; 0]| [dot(step, pulled), dot(step, rest)];
            let [own, gain] = in_strips(control, [step, pulled, &rest], [], of_step);
            if own <= 0.0 {
                break;
            }
            *energy = own;
            let length = gain / own;
            let (read, written) = ([&**step, pulled], [&mut *solution, &mut rest]);
            [square] = in_strips(control, read, written, |[step, pulled], [solution, rest]| {
                add(length, step, solution);
                add(-length, pulled, rest);
                [dot(rest, rest)]
            });
            taken += 1;
        }
        solution
    }

    /// Writes a step for `residual`, and what it pulls, to the directions at `place`.
    fn step(&mut self, control: &Control<'_>, residual: &[f64], place: usize) {
        let Self { sweeps, motions, coarse, moved, rest, taken } = self;
        let Taken { step, pulled, .. } = &mut taken[place];
        let motion = coarse.solve(control, &motions.gathered(control, residual));
        motions.move_all(control, &motion, moved);
        rest.copy_from_slice(residual);
        sweeps.improve(control, moved, step, rest);
        in_strips(control, [residual, rest, moved], [pulled, step], |[residual, rest, moved], [pulled, step]| {
            for ((residual, rest), pulled) in residual.iter().zip(rest).zip(pulled) {
                *pulled = residual - rest;
            }
            add(1.0, moved, step);
            []
        });
    }
}
