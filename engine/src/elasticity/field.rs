//! Stress fields: stress and displacement of each block, by either method.

use serde::{Deserialize, Serialize};

use super::{Control, Stopped, fem, sph};
use crate::voxel::Cell;

/// Method of computing stress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The published simulation.
    Sph,
    /// Equilibrium by finite elements.
    Fem,
}

/// Version of the numbers in a field. Any change that can alter one increments it.
pub const FIELD_VERSION: u32 = 1;

/// Stress and displacement of each block.
#[derive(Debug, Clone, Default)]
pub struct Field {
    /// Greatest von Mises stress, Pa; `None` if there is no finite value.
    pub max_von_mises_pa: Option<f64>,
    /// Von Mises stress of each entry, Pa; `None` where the method leaves the block out.
    pub von_mises_pa: Vec<Option<f64>>,
    /// Displacement of each entry's centre, m (blocks): east, up, south; `None` where there are no finite values.
    pub displacement_m: Vec<Option<[f64; 3]>>,
    /// Reasons to read the field with care.
    pub cautions: Vec<String>,
}

impl Field {
    /// Computes the field of `cells`, in their order.
    ///
    /// # Errors
    /// Returns an error if `control` stops the computation.
    pub fn of(cells: &[Cell], method: Method, control: &Control<'_>) -> Result<Self, Stopped> {
        match method {
            Method::Sph => {
                let outcome = sph::simulate(cells, control)?;
                let finite = |number: f64| number.is_finite().then_some(number);
                let mut von_mises_pa: Vec<_> = outcome.von_mises_pa.iter().map(|&stress| finite(stress)).collect();
                // These entries count as 0 for the published maximum, but have no stress to show.
                for &entry in outcome.diagnostics.degenerate.iter().chain(&outcome.diagnostics.non_finite) {
                    von_mises_pa[entry as usize] = None;
                }
                Ok(Self {
                    max_von_mises_pa: finite(outcome.max_von_mises_pa),
                    von_mises_pa,
                    displacement_m: outcome
                        .displacement_m
                        .iter()
                        .map(|moved| moved.iter().all(|k| k.is_finite()).then_some(*moved))
                        .collect(),
                    cautions: outcome.diagnostics.cautions(),
                })
            }
            Method::Fem => {
                let outcome = fem::solve_equilibrium(cells, control)?;
                let cautions = outcome.cautions();
                Ok(Self {
                    max_von_mises_pa: outcome.max_von_mises_pa,
                    von_mises_pa: outcome.von_mises_pa,
                    displacement_m: outcome.displacement_m,
                    cautions,
                })
            }
        }
    }
}
