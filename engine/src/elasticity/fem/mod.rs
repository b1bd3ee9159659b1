//! A well-posed method: static linear elasticity on the mesh of blocks, one eight-node hexahedron per block.
//!
//! It yields a sound value where the published method yields none or an artefact: for parts one block thick, and for
//! structures that are not at rest after the 0.2 s that the published method simulates.

use crate::text::agreeing;

mod block_matrix;
mod conjugate_gradients;
mod element;
mod factor;
mod groups;
mod levels;
mod mesh;
mod modes;
mod motions;
mod partition;
mod pipeline;
mod root;
mod shares;
mod smoothing;
mod steps;
mod sweeps;
mod system;
mod vectors;
#[cfg(test)]
mod verification;

use super::{Control, Stopped, WEIGHT_N};
use crate::voxel::Cell;
use conjugate_gradients::solve;
use element::ELEMENT;
use mesh::{Mesh, Supported};
use system::{System, centre};

/// Stress and displacement in equilibrium.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Greatest von Mises stress, Pa; `None` if no block is supported or the equations were not solved.
    pub max_von_mises_pa: Option<f64>,
    /// Entry with the greatest stress.
    pub most_stressed: Option<usize>,
    /// Greatest von Mises stress at the integration points of each entry's block, in the order given, Pa; `None` for an
    /// unsupported entry, and for all if the equations were not solved.
    pub von_mises_pa: Vec<Option<f64>>,
    /// Displacement of the centre of each entry's block, m; `None` under the same conditions as the stress.
    pub displacement_m: Vec<Option<[f64; 3]>>,
    /// Entries not connected through faces to a block at the least y, ascending: they have no equilibrium.
    pub unsupported: Vec<u32>,
    /// Greatest displacement of a supported block's centre, m; `None` under the same conditions as the greatest stress.
    pub max_displacement_m: Option<f64>,
    /// Number of solver iterations.
    pub iterations: u32,
    /// Whether the equations were solved.
    pub is_solved: bool,
    /// Norm of the residual force relative to that of the load: in a solution, 1e-8 or what rounding leaves.
    pub relative_residual: f64,
}

impl Outcome {
    /// Returns reasons to read the result with care; empty for a complete result.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let mut cautions = Vec::new();
        if !self.unsupported.is_empty() {
            cautions.push(format!(
                "{} not connected to the lowest level through faces, and left out by fem",
                agreeing(self.unsupported.len(), "block is", "blocks are")
            ));
        }
        if !self.is_solved {
            cautions.push(format!(
                "fem did not converge: after {} iterations the residual is {:.1e} of the load",
                self.iterations, self.relative_residual
            ));
        }
        if self.is_solved && self.relative_residual > MAX_ROUNDING {
            cautions.push(format!(
                "the structure bends so far that rounding leaves forces of {:.1e} of the load: the figures of fem are not reliable",
                self.relative_residual
            ));
        }
        cautions
    }
}

/// Residual force of a solution, relative to the load, above which its figures are not reliable.
const MAX_ROUNDING: f64 = 1e-3;

/// Solves for the equilibrium of `cells` under their weight, held at the base of the blocks at the least y. A cell
/// listed several times is one block.
///
/// # Errors
/// Returns an error if `control` stops the computation; it is polled every few milliseconds once iterations run, or after
/// each iteration if one takes longer, and between the stages of setup, which take some microseconds per block.
pub fn solve_equilibrium(cells: &[Cell], control: &Control<'_>) -> Result<Outcome, Stopped> {
    let supported = Supported::of(cells);
    let lowest = cells.iter().map(|cell| cell.y).min().unwrap_or(0);
    control.check(0.0)?;
    let mesh = Mesh::new(supported.cells);
    control.check(0.0)?;
    let system = System::new(&mesh, &ELEMENT, 1.0, |position| position[1] == lowest);
    let mut displacement = vec![0.0; system.len()];
    let convergence = solve(&system, &system.weight(WEIGHT_N), &mut displacement, control)?;
    let blocks: Vec<(f64, [f64; 3])> = (0..mesh.cells.len())
        .map(|block| {
            let corners = system.corners(block, &displacement);
            (ELEMENT.von_mises(&corners, 1.0).into_iter().fold(0.0, f64::max), centre(&corners))
        })
        .collect();
    let of_entry = |index: &Option<u32>| index.filter(|_| convergence.is_solved).map(|index| blocks[index as usize]);
    let entries: Vec<_> = supported.index.iter().map(of_entry).collect();
    let greatest = entries.iter().flatten().map(|(stress, _)| *stress).reduce(f64::max);
    let length = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
    Ok(Outcome {
        max_von_mises_pa: greatest,
        // Ties go to the least cell, whatever the order of the list.
        most_stressed: (0..cells.len())
            .filter(|&i| entries[i].is_some_and(|(stress, _)| Some(stress) == greatest))
            .min_by_key(|&i| cells[i]),
        von_mises_pa: entries.iter().map(|entry| entry.map(|(stress, _)| stress)).collect(),
        displacement_m: entries.iter().map(|entry| entry.map(|(_, displacement)| displacement)).collect(),
        unsupported: (0..).zip(&supported.index).filter(|(_, index)| index.is_none()).map(|(i, _)| i).collect(),
        max_displacement_m: entries.iter().flatten().map(|(_, moved)| length(*moved)).reduce(f64::max),
        iterations: convergence.iterations,
        is_solved: convergence.is_solved,
        relative_residual: convergence.relative_residual,
    })
}
