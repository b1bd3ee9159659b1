//! What a simulation found, and how far it can be trusted.

use nalgebra::{Matrix3, Vector3};

/// Result of a simulation.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Greatest von Mises stress, Pa; not a number where a particle's stress is not.
    pub max_von_mises_pa: f64,
    /// Von Mises stress per entry, in the order given, Pa; 0 where the method leaves a particle out.
    pub von_mises_pa: Vec<f64>,
    /// Displacement per entry at the end, in blocks (metres).
    pub displacement_m: Vec<[f64; 3]>,
    /// Entry with the greatest stress.
    pub most_stressed: Option<usize>,
    /// What tells how far to trust the above.
    pub diagnostics: Diagnostics,
}

/// What tells how far to trust a simulation. Lists are of entries, ascending.
#[derive(Debug, Clone, Default)]
pub struct Diagnostics {
    /// Entries whose neighbours lie in one plane or line, so that their moment matrix A is singular.
    pub singular_moment: Vec<u32>,
    /// Entries left out because |det F| < 1e-12.
    pub degenerate: Vec<u32>,
    /// Entries left out because det F is not finite: the simulation blew up there.
    pub non_finite: Vec<u32>,
    /// Entries that no chain of neighbours (by face, edge or corner) connects with a held block: they fall.
    pub unconnected: Vec<u32>,
    /// Whether some neighbourhood is flat in a sloped plane or line, where rounding decides what A's pseudo-inverse is.
    pub sloped: bool,
    /// Entries that share their cell with an earlier entry.
    pub repeated_cells: usize,
    /// Greatest length of a displacement at the end, in blocks (metres).
    pub max_displacement_m: f64,
    /// Greatest net force on a particle in the last step, N; 0 in equilibrium.
    pub residual_force_n: f64,
    /// Kinetic energy at the end, J; 0 at rest.
    pub kinetic_energy_j: f64,
    /// Whether rounding decides the result, so that it is undefined (conformance quirks 1 and 2).
    pub order_sensitive: bool,
}

impl Diagnostics {
    /// Why the result must be read with care, in words; empty for a sound one.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let mut cautions = Vec::new();
        if !self.singular_moment.is_empty() {
            cautions.push(format!(
                "{} blocks have all neighbours in one plane or line (singular moment matrix): their stress is an \
                 artefact of the published method",
                self.singular_moment.len()
            ));
        }
        if !self.degenerate.is_empty() {
            cautions.push(format!("{} blocks are left out because |det F| < 1e-12", self.degenerate.len()));
        }
        if !self.non_finite.is_empty() {
            cautions
                .push(format!("{} blocks are left out because the simulation blew up there", self.non_finite.len()));
        }
        if !self.unconnected.is_empty() {
            cautions.push(format!(
                "{} blocks are not connected with the lowest level: the published method lets them fall",
                self.unconnected.len()
            ));
        }
        if self.max_displacement_m > WILD_M || self.max_displacement_m.is_nan() {
            cautions.push(format!(
                "blocks moved by up to {:.2} blocks: the figure is one moment of a motion that amplifies rounding",
                self.max_displacement_m
            ));
        }
        if self.repeated_cells > 0 {
            cautions.push(format!("{} entries share a cell with an earlier entry", self.repeated_cells));
        }
        if self.order_sensitive {
            cautions.push(
                "the figure is undefined: rounding decides it, and another order of the blocks gives another value"
                    .to_owned(),
            );
        }
        cautions
    }
}

/// Displacement beyond which a structure is not settling but flailing, in blocks (metres); sound ones move by 1e-4.
const WILD_M: f64 = 0.01;

/// Below this |det F| a particle's stress counts as 0.
const DEGENERATE_JACOBIAN: f64 = 1e-12;

/// What becomes of one particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// It has a von Mises stress, Pa.
    Stressed(f64),
    /// It is left out: |det F| < 1e-12.
    Degenerate,
    /// It is left out: det F is not finite.
    NonFinite,
}

/// Von Mises stress of `sigma = P F^T / J`, from P in Pa and F.
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

/// Von Mises stress of a Cauchy stress tensor.
fn von_mises(cauchy: &Matrix3<f64>) -> f64 {
    let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
    (1.5 * deviator.norm_squared()).sqrt()
}

/// Greatest length among vectors; not a number where one is not.
pub fn greatest_length(vectors: impl IntoIterator<Item = [f64; 3]>) -> f64 {
    vectors.into_iter().map(|v| Vector3::from(v).norm()).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
}
