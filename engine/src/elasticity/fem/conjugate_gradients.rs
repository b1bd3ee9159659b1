//! Preconditioned conjugate gradients.

use nalgebra::Vector3;

use super::coarse::{Coarse, dot};
use super::system::System;
use crate::elasticity::{Control, Stopped};

/// Residual force, relative to the load, at which a solution is accepted.
pub const TOLERANCE: f64 = 1e-8;
/// Greatest number of iterations.
const MAX_ITERATIONS: usize = 20_000;
/// Greatest product of iterations and blocks, some ten seconds: more than twice what any structure tried has needed.
const MAX_WORK: usize = 100_000_000;
/// Work between two polls of the stop signal, in iterations times blocks: some milliseconds.
const WORK_PER_LOOK: usize = 50_000;

/// State of a solution when the iterations ended.
#[derive(Debug, Clone, Copy, Default)]
pub struct Convergence {
    /// Number of iterations.
    pub iterations: u32,
    /// Whether the residual that the iterations update reached [`TOLERANCE`].
    pub is_solved: bool,
    /// Norm of the residual force, recomputed from the solution, relative to that of the load. If displacements are
    /// many times a block's size, rounding leaves more than the tolerance.
    pub relative_residual: f64,
}

/// Changes the displacements of free nodes until the forces on them balance `load`. Held nodes stay as they are.
///
/// # Errors
/// Returns an error if `control` stops the computation; it is polled every few milliseconds once the iterations run.
pub fn solve(
    system: &System<'_>,
    load: &[f64],
    displacement: &mut [f64],
    control: &Control<'_>,
) -> Result<Convergence, Stopped> {
    let len = system.len();
    let mut residual = vec![0.0; len];
    system.apply(displacement, &mut residual);
    for (residual, load) in residual.iter_mut().zip(load) {
        *residual = load - *residual;
    }
    system.release(&mut residual);
    let scale = dot(load, load).sqrt().max(dot(&residual, &residual).sqrt());
    let mut convergence = Convergence::default();
    if scale == 0.0 {
        convergence.is_solved = true;
        return Ok(convergence);
    }
    control.check(0.0)?;
    let preconditioner = Preconditioner { diagonal: system.inverse_diagonal(), coarse: Coarse::new(system, control)? };
    let blocks = system.mesh.nodes.len().max(1);
    let per_look = (WORK_PER_LOOK / blocks).clamp(1, 500) as u32;
    let most = (MAX_WORK / blocks).min(MAX_ITERATIONS) as u32;
    let (mut direction, mut pulled, mut step) = (vec![0.0; len], vec![0.0; len], vec![0.0; len]);
    let mut before = 0.0;
    loop {
        convergence.relative_residual = dot(&residual, &residual).sqrt() / scale;
        convergence.is_solved = convergence.relative_residual <= TOLERANCE;
        let is_lost = convergence.relative_residual.is_nan();
        if convergence.is_solved || is_lost || convergence.iterations >= most {
            break;
        }
        if convergence.iterations % per_look == 0 {
            control.check((convergence.relative_residual.log10() / TOLERANCE.log10()).clamp(0.0, 1.0))?;
        }
        preconditioner.apply(system, &residual, &mut step);
        let now = dot(&residual, &step);
        let part = if convergence.iterations == 0 { 0.0 } else { now / before };
        for (direction, step) in direction.iter_mut().zip(&step) {
            *direction = step + part * *direction;
        }
        system.apply(&direction, &mut pulled);
        let length = now / dot(&direction, &pulled);
        for ((moved, residual), (direction, pulled)) in
            displacement.iter_mut().zip(&mut residual).zip(direction.iter().zip(&pulled))
        {
            *moved += length * direction;
            *residual -= length * pulled;
        }
        before = now;
        convergence.iterations += 1;
    }
    system.apply(displacement, &mut pulled);
    for (pulled, load) in pulled.iter_mut().zip(load) {
        *pulled = load - *pulled;
    }
    system.release(&mut pulled);
    convergence.relative_residual = dot(&pulled, &pulled).sqrt() / scale;
    Ok(convergence)
}

/// Sum of a preconditioner of single nodes and one of groups of nodes as rigid bodies.
struct Preconditioner {
    diagonal: Vec<nalgebra::Matrix3<f64>>,
    coarse: Option<Coarse>,
}

impl Preconditioner {
    fn apply(&self, system: &System<'_>, residual: &[f64], step: &mut [f64]) {
        for ((step, residual), inverse) in step.chunks_exact_mut(3).zip(residual.chunks_exact(3)).zip(&self.diagonal) {
            let moved = inverse * Vector3::new(residual[0], residual[1], residual[2]);
            step.copy_from_slice(moved.as_slice());
        }
        system.release(step);
        if let Some(coarse) = &self.coarse {
            coarse.add_solution(residual, step);
        }
    }
}
