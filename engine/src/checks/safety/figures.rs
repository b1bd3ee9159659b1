//! Figures of both stress methods for a structure, as reports show them.

use serde::{Deserialize, Serialize};

use crate::checks::sample::CellSample;
use crate::elasticity::{fem, sph};
use crate::voxel::Cell;

/// Figures of the published method, with diagnostics of how far to trust them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SphFigures {
    /// Greatest von Mises stress, Pa; null if it is not a number.
    pub max_von_mises_pa: Option<f64>,
    /// Block with the greatest stress.
    #[schema(value_type = Option<[i32; 3]>)]
    pub at: Option<Cell>,
    /// Whether rounding decides the stress, which makes it undefined.
    pub is_undefined: bool,
    /// Blocks whose neighbours lie in one plane or line: the moment matrix A is singular and the stress an artefact.
    pub singular_moment: CellSample,
    /// Blocks left out because |det F| < 1e-12.
    pub degenerate: CellSample,
    /// Blocks left out because the simulation diverged there.
    pub non_finite: CellSample,
    /// Blocks that no chain of neighbours connects to the lowest level; they fall.
    pub unconnected: CellSample,
    /// Greatest displacement at the end, m (blocks); null if it is not a number.
    pub max_displacement_m: Option<f64>,
    /// Greatest net force on a block at the end, N: 0 in equilibrium; null if it is not a number.
    pub residual_force_n: Option<f64>,
    /// Kinetic energy at the end, J: 0 at rest; null if it is not a number.
    pub kinetic_energy_j: Option<f64>,
}

impl SphFigures {
    /// Collects the figures of a simulation of `cells`.
    #[must_use]
    pub fn of(cells: &[Cell], outcome: &sph::Outcome) -> Self {
        let finite = |number: f64| number.is_finite().then_some(number);
        let found = &outcome.diagnostics;
        Self {
            max_von_mises_pa: finite(outcome.max_von_mises_pa),
            at: outcome.most_stressed.map(|entry| cells[entry]),
            is_undefined: found.order_sensitive,
            singular_moment: CellSample::of(cells, &found.singular_moment),
            degenerate: CellSample::of(cells, &found.degenerate),
            non_finite: CellSample::of(cells, &found.non_finite),
            unconnected: CellSample::of(cells, &found.unconnected),
            max_displacement_m: finite(found.max_displacement_m),
            residual_force_n: finite(found.residual_force_n),
            kinetic_energy_j: finite(found.kinetic_energy_j),
        }
    }
}

/// Figures of the equilibrium by finite elements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FemFigures {
    /// Greatest von Mises stress, Pa; null if no block is supported or the equations were not solved.
    pub max_von_mises_pa: Option<f64>,
    /// Block with the greatest stress.
    #[schema(value_type = Option<[i32; 3]>)]
    pub at: Option<Cell>,
    /// Blocks not connected to the lowest level through shared faces: they have no equilibrium and are left out.
    pub unsupported: CellSample,
    /// Greatest displacement, m (blocks); null under the same conditions as the stress.
    pub max_displacement_m: Option<f64>,
    /// Number of solver iterations.
    pub iterations: u32,
    /// Ratio of the residual force to the load at the end: 1e-8, or what rounding leaves if displacements are enormous;
    /// null if it is not a number.
    pub relative_residual: Option<f64>,
    /// Cautions that say what the figures leave out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cautions: Vec<String>,
}

impl FemFigures {
    /// Collects the figures of an equilibrium of `cells`.
    #[must_use]
    pub fn of(cells: &[Cell], outcome: &fem::Outcome) -> Self {
        Self {
            max_von_mises_pa: outcome.max_von_mises_pa,
            at: outcome.most_stressed.map(|entry| cells[entry]),
            unsupported: CellSample::of(cells, &outcome.unsupported),
            max_displacement_m: outcome.max_displacement_m,
            iterations: outcome.iterations,
            relative_residual: Some(outcome.relative_residual).filter(|residual| residual.is_finite()),
            cautions: outcome.cautions(),
        }
    }
}

/// Figures of both methods side by side. The score comes from `sph`, as published; `fem` is for comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct StressFigures {
    /// The published simulation.
    pub sph: SphFigures,
    /// The well-posed equilibrium.
    pub fem: FemFigures,
}
