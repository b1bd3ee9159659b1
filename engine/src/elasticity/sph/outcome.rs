//! Outcome of a simulation, and diagnostics of how far to trust it.

use crate::text::agreeing;
use nalgebra::{Matrix3, Vector3};

/// Result of a simulation.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Greatest von Mises stress, Pa; NaN if a particle's stress is NaN.
    pub max_von_mises_pa: f64,
    /// Von Mises stress per entry, in the order given, Pa; 0 where the method leaves a particle out.
    pub von_mises_pa: Vec<f64>,
    /// Displacement per entry at the end, in blocks (metres).
    pub displacement_m: Vec<[f64; 3]>,
    /// Entry with the greatest stress.
    pub most_stressed: Option<usize>,
    /// Diagnostics of how far to trust the result.
    pub diagnostics: Diagnostics,
}

/// Diagnostics of how far to trust a simulation. Lists contain entries in ascending order.
#[derive(Debug, Clone, Default)]
pub struct Diagnostics {
    /// Entries without neighbours or with all neighbours in one plane or line, so that their moment matrix A is
    /// singular.
    pub singular_moment: Vec<u32>,
    /// Entries left out because |det F| < 1e-12.
    pub degenerate: Vec<u32>,
    /// Entries left out because det F is not finite: the simulation diverged there.
    pub non_finite: Vec<u32>,
    /// Entries that no chain of neighbours (by face, edge or corner) connects to a held block; they fall.
    pub unconnected: Vec<u32>,
    /// Whether some neighbourhood lies in a sloped plane or line, where rounding decides the pseudo-inverse of A.
    pub sloped: bool,
    /// Number of entries that share their cell with an earlier entry.
    pub repeated_cells: usize,
    /// Greatest displacement at the end, in blocks (metres).
    pub max_displacement_m: f64,
    /// Greatest net force on a particle in the last step, N; 0 in equilibrium.
    pub residual_force_n: f64,
    /// Kinetic energy at the end, J; 0 at rest.
    pub kinetic_energy_j: f64,
    /// Whether rounding decides the result, which makes it undefined (conformance quirks 1 and 2).
    pub order_sensitive: bool,
}

impl Diagnostics {
    /// Returns reasons to read the result with care; empty for a sound result.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let blocks_are = |blocks: &[u32]| agreeing(blocks.len(), "block is", "blocks are");
        let mut cautions = Vec::new();
        if !self.singular_moment.is_empty() {
            cautions.push(format!(
                "{} all neighbours in one plane or line (singular moment matrix): the stress there is an artefact of \
                 the published method",
                agreeing(self.singular_moment.len(), "block has", "blocks have")
            ));
        }
        if !self.degenerate.is_empty() {
            cautions.push(format!("{} left out because |det F| < 1e-12", blocks_are(&self.degenerate)));
        }
        if !self.non_finite.is_empty() {
            cautions.push(format!("{} left out because the simulation diverged there", blocks_are(&self.non_finite)));
        }
        if !self.unconnected.is_empty() {
            cautions.push(format!(
                "{} not connected to the lowest level, which the published method lets fall",
                blocks_are(&self.unconnected)
            ));
        }
        if !self.max_displacement_m.is_finite() {
            let told = "the motion of the published method grew without bound";
            cautions.push(told.to_owned());
        } else if self.max_displacement_m > WILD_M {
            cautions.push(format!(
                "blocks moved by up to {:.2} blocks: the figure is a snapshot of a motion that amplifies rounding",
                self.max_displacement_m
            ));
        }
        if self.repeated_cells > 0 {
            cautions.push(format!(
                "{} a cell with an earlier entry",
                agreeing(self.repeated_cells, "entry shares", "entries share")
            ));
        }
        if self.order_sensitive {
            cautions.push(
                "the figure is undefined: it depends on rounding, and in the published evaluator on the order of blocks"
                    .to_owned(),
            );
        }
        cautions
    }
}

/// Displacement beyond which a structure is not settling, in blocks (metres); sound structures move by 1e-4.
const WILD_M: f64 = 0.01;

/// Value of |det F| below which a particle's stress counts as 0.
const DEGENERATE_JACOBIAN: f64 = 1e-12;

/// Result of one particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// The particle has this von Mises stress, Pa.
    Stressed(f64),
    /// The particle is left out: |det F| < 1e-12.
    Degenerate,
    /// The particle is left out: det F is not finite.
    NonFinite,
}

/// Computes the von Mises stress of `sigma = P F^T / J` from P in Pa and F, unless the particle is left out.
#[must_use]
pub fn fate(stress: &Matrix3<f64>, deformation: &Matrix3<f64>) -> Fate {
    let jacobian = deformation.determinant();
    if !jacobian.is_finite() {
        Fate::NonFinite
    } else if jacobian.abs() < DEGENERATE_JACOBIAN {
        Fate::Degenerate
    } else {
        Fate::Stressed(von_mises(&(stress * deformation.transpose() / jacobian)))
    }
}

/// Returns the von Mises stress of a Cauchy stress tensor.
fn von_mises(cauchy: &Matrix3<f64>) -> f64 {
    let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
    (1.5 * deviator.norm_squared()).sqrt()
}

/// Returns the greatest length among vectors; NaN if one is NaN.
pub fn greatest_length(vectors: impl IntoIterator<Item = [f64; 3]>) -> f64 {
    vectors.into_iter().map(|v| Vector3::from(v).norm()).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
}
