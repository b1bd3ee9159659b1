//! Preconditioned conjugate gradients.

use super::levels::Levels;
use super::system::System;
use super::vectors::{add, dot, in_strips, subtract};
use crate::elasticity::{Control, Stopped};

/// Residual force, relative to the load, at which a solution is accepted.
pub const TOLERANCE: f64 = 1e-8;
/// Greatest number of iterations: ten times what any structure tried has needed.
const MAX_ITERATIONS: usize = 1_500;
/// Greatest product of iterations and blocks, some twenty seconds: twice what any structure tried has needed.
const MAX_WORK: usize = 25_000_000;
/// Work between two polls of the stop signal, in iterations times blocks: some milliseconds.
const WORK_PER_LOOK: usize = 10_000;

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
/// Returns an error if `control` stops the computation; it is polled every few milliseconds once the iterations run, or
/// after each iteration if one takes longer.
pub fn solve(
    system: &System<'_>,
    load: &[f64],
    displacement: &mut [f64],
    control: &Control<'_>,
) -> Result<Convergence, Stopped> {
    let len = system.len();
    let mut residual = vec![0.0; len];
    subtract(load, |pulled| system.apply(displacement, pulled), &mut residual);
    system.release(&mut residual);
    let scale = dot(load, load).sqrt().max(dot(&residual, &residual).sqrt());
    let mut convergence = Convergence::default();
    if scale == 0.0 {
        convergence.is_solved = true;
        return Ok(convergence);
    }
    control.check(0.0)?;
    let mut levels = Levels::new(system, control)?;
    let blocks = system.mesh.nodes.len().max(1);
    let per_look = (WORK_PER_LOOK / blocks).clamp(1, 500) as u32;
    let most = (MAX_WORK / blocks).min(MAX_ITERATIONS) as u32;
    let (mut direction, mut pulled) = (vec![0.0; len], vec![0.0; len]);
    let (mut step, mut by_step) = (vec![0.0; len], vec![0.0; len]);
    if let Some(first) = levels.first(&residual, control) {
        system.apply(&first, &mut pulled);
        add(1.0, &first, displacement);
        add(-1.0, &pulled, &mut residual);
    }
    let mut energy = 0.0;
    let mut square = dot(&residual, &residual);
    loop {
        convergence.relative_residual = square.sqrt() / scale;
        convergence.is_solved = convergence.relative_residual <= TOLERANCE;
        let is_lost = convergence.relative_residual.is_nan();
        if convergence.is_solved || is_lost || convergence.iterations >= most {
            break;
        }
        if convergence.iterations % per_look == 0 {
            control.check((convergence.relative_residual.log10() / TOLERANCE.log10()).clamp(0.0, 1.0))?;
        }
        levels.step(system, control, &residual, &mut step, &mut by_step);
        // The preconditioner is not quite the same in each iteration, so the direction is made conjugate explicitly.
        let [common] = in_strips(control, [&step, &pulled], [], |[step, pulled], []| [dot(step, pulled)]);
        let part = if energy > 0.0 { common / energy } else { 0.0 };
        let (read, written) = ([&*step, &by_step, &residual], [&mut *direction, &mut pulled]);
        let sums = in_strips(control, read, written, |[step, by_step, residual], [direction, pulled]| {
            for (direction, step) in direction.iter_mut().zip(step).chain(pulled.iter_mut().zip(by_step)) {
                *direction = step - part * *direction;
            }
            [dot(direction, pulled), dot(residual, direction)]
        });
        energy = sums[0];
        let length = sums[1] / energy;
        let (read, written) = ([&*direction, &pulled], [&mut *displacement, &mut residual]);
        [square] = in_strips(control, read, written, |[direction, pulled], [displacement, residual]| {
            add(length, direction, displacement);
            add(-length, pulled, residual);
            [dot(residual, residual)]
        });
        convergence.iterations += 1;
    }
    subtract(load, |pulled| system.apply(displacement, pulled), &mut residual);
    system.release(&mut residual);
    convergence.relative_residual = dot(&residual, &residual).sqrt() / scale;
    Ok(convergence)
}
