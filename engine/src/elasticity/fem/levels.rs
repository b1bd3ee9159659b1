//! The preconditioner: levels of groups that move as rigid bodies, each a smaller set of equations.
//!
//! Single nodes spread a load slowly and hardly resolve the bending of long thin parts, but the joint motion of
//! neighbouring nodes is nearly rigid. So each level solves the equations of each group by itself, and those of the
//! groups' rigid motions together: directly where that is little work, otherwise by the next level.

use nalgebra::Vector3;

use super::block_matrix::BlockMatrix;
use super::factor::Factor;
use super::local::Local;
use super::motions::{MOTIONS, Motions};
use super::partition::Partition;
use super::system::System;
use super::vectors::{dot, subtract};
use crate::elasticity::{Control, Stopped};

/// Work of a direct solution for each block of the structure, in multiply-adds. More would cost more than it saves.
const MOST_WORK: usize = 5_000;
/// Nodes for each block below which a structure is taken to be solid: boxes of it are as good as rigid.
const SOLID: f64 = 1.5;
/// Least edge of a box of a solid structure, in blocks.
const LEAST_EDGE: f64 = 4.0;
/// Number of products by which the greatest eigenvalue of smoothed equations is estimated.
const ESTIMATES: usize = 8;
/// Weight of a smoothing step times the estimate. The product with the eigenvalue itself, of which the estimate is a lower
/// bound, must stay below two.
const WEIGHT: f64 = 1.6;
/// Part of the residual at which one step of a nested solution is enough.
const ENOUGH: f64 = 0.25;

/// Approximate solution of a system, as a preconditioner.
#[derive(Debug)]
pub struct Levels {
    local: Local,
    motions: Motions<3>,
    coarse: Coarse,
    /// Weight of the smoothing.
    weight: f64,
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
    matrix: BlockMatrix,
    local: Local,
    motions: Motions<MOTIONS>,
    coarse: Coarse,
    weight: f64,
}

impl Levels {
    /// Sets up the levels of a system.
    ///
    /// # Errors
    /// Returns an error if `control` stops the computation; it is polled between the parts.
    pub fn new(system: &System<'_>, control: &Control<'_>) -> Result<Self, Stopped> {
        let partition = Partition::of_nodes(system);
        control.check(0.0)?;
        let local = Local::of_nodes(system, &partition);
        control.check(0.0)?;
        let position: Vec<Vector3<f64>> =
            system.mesh.position.iter().map(|position| Vector3::from(position.map(f64::from))).collect();
        let motions = Motions::new(partition, &position);
        let matrix = BlockMatrix::of_system(system, &motions);
        control.check(0.0)?;
        let blocks = system.mesh.nodes.len();
        let (motions, coarse) = if (system.mesh.position.len() as f64) < SOLID * blocks as f64 {
            in_boxes(&matrix, motions, MOST_WORK * blocks, control)?
        } else {
            let coarse = Coarse::new(matrix, &motions.middle, MOST_WORK * blocks, control)?;
            (motions, coarse)
        };
        let weight = match coarse {
            Coarse::Direct(_) => 1.0,
            Coarse::Nested(_) => weight(system.len(), &local, |from, to| system.apply(from, to)),
        };
        Ok(Self { local, motions, coarse, weight })
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

    /// Computes an approximate solution for `residual`.
    pub fn step(&self, system: &System<'_>, residual: &[f64], step: &mut [f64]) {
        step.fill(0.0);
        self.local.add_solution(self.weight, residual, step);
        let mut rest = vec![0.0; residual.len()];
        subtract(residual, |rest| system.apply(step, rest), &mut rest);
        self.motions.add_to_members(&self.coarse.solve(&self.motions.gathered(&rest)), step);
        if let Coarse::Nested(_) = self.coarse {
            subtract(residual, |rest| system.apply(step, rest), &mut rest);
            self.local.add_solution(self.weight, &rest, step);
        }
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
        let partition = Partition::of_groups(&matrix);
        let local = Local::of_groups(&matrix, &partition);
        let motions = Motions::new(partition, middle);
        let coarse = Self::new(matrix.coarser(&motions), &motions.middle, most_work, control)?;
        let weight = weight(MOTIONS * matrix.len(), &local, |from, to| matrix.apply(from, to));
        Ok(Self::Nested(Box::new(Nested { matrix, local, motions, coarse, weight })))
    }

    fn solve(&self, force: &[f64]) -> Vec<f64> {
        match self {
            Self::Direct(factor) => factor.solve(force),
            Self::Nested(nested) => nested.solve(force),
        }
    }
}

impl Nested {
    /// Solves by at most two steps of conjugate gradients (Notay 2008, the K-cycle): the number of iterations then
    /// hardly depends on the number of levels.
    fn solve(&self, force: &[f64]) -> Vec<f64> {
        let product = |vector: &[f64]| {
            let mut product = vec![0.0; vector.len()];
            self.matrix.apply(vector, &mut product);
            product
        };
        let first = self.step(force);
        let pulled = product(&first);
        let energy = dot(&first, &pulled);
        if energy <= 0.0 {
            return first;
        }
        let part = dot(&first, force) / energy;
        let rest: Vec<f64> = force.iter().zip(&pulled).map(|(force, pulled)| force - part * pulled).collect();
        if dot(&rest, &rest) <= ENOUGH * ENOUGH * dot(force, force) {
            return first.into_iter().map(|entry| part * entry).collect();
        }
        let second = self.step(&rest);
        let of_second = product(&second);
        let mixed = dot(&second, &pulled) / energy;
        let own = dot(&second, &of_second) - mixed * mixed * energy;
        let more = if own > 0.0 { dot(&second, &rest) / own } else { 0.0 };
        first.iter().zip(&second).map(|(first, second)| (part - mixed * more) * first + more * second).collect()
    }

    fn step(&self, residual: &[f64]) -> Vec<f64> {
        let mut step = vec![0.0; residual.len()];
        let mut rest = vec![0.0; residual.len()];
        self.local.add_solution(self.weight, residual, &mut step);
        subtract(residual, |rest| self.matrix.apply(&step, rest), &mut rest);
        self.motions.add_to_members(&self.coarse.solve(&self.motions.gathered(&rest)), &mut step);
        subtract(residual, |rest| self.matrix.apply(&step, rest), &mut rest);
        self.local.add_solution(self.weight, &rest, &mut step);
        step
    }
}

/// Returns a weight with which smoothing reduces every part of an error, as far as an estimate tells.
fn weight(len: usize, local: &Local, apply: impl Fn(&[f64], &mut [f64])) -> f64 {
    // Any vector that has a part of the one that is sought will do.
    let mut vector: Vec<f64> = (0..len).map(|i| 1.0 + (i as f64).sin()).collect();
    let mut pulled = vec![0.0; len];
    let mut greatest = 1.0;
    for _ in 0..ESTIMATES {
        apply(&vector, &mut pulled);
        vector.fill(0.0);
        local.add_solution(1.0, &pulled, &mut vector);
        greatest = dot(&vector, &vector).sqrt();
        if greatest == 0.0 {
            return 1.0;
        }
        for entry in &mut vector {
            *entry /= greatest;
        }
    }
    WEIGHT / greatest
}
