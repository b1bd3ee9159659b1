//! Elasticity: von Mises stress of a structure under its own weight (SPEC 4; paper, appendix "Von Mises Stress").
//!
//! Methods, units, sources and verification are told in this room's README.md.

pub mod fem;
pub mod field;
mod lanes;
mod lattice;
mod neighbours;
pub mod small_matrix;
pub mod sph;

/// Weight of a block, N.
pub const WEIGHT_N: f64 = 900.0;
/// Young's modulus, Pa.
pub const YOUNG_PA: f64 = 1e9;
/// Poisson's ratio.
pub const POISSON: f64 = 0.4;

/// A computation ended early because it was asked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the end")]
pub struct Stopped;

/// Does two jobs, at the same time where that is quicker, and returns when both are done.
pub type Join<'a> = dyn Fn(&mut (dyn FnMut() + Send), &mut (dyn FnMut() + Send)) + Sync + 'a;

/// How a long computation is watched, ended and shared out. This room has no threads of its own.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Asked now and then; true ends the computation.
    pub stop: &'a (dyn Fn() -> bool + Sync),
    /// Told now and then which part, from 0 to 1, is done.
    pub progress: Option<&'a (dyn Fn(f64) + Sync)>,
    /// Lends other cores to large structures; results do not depend on it.
    pub join: Option<&'a Join<'a>>,
}

impl<'a> Control<'a> {
    /// A computation on one core that runs to its end.
    #[must_use]
    pub const fn unhurried() -> Self {
        Self { stop: &|| false, progress: None, join: None }
    }

    /// A computation on one core that ends when `stop` says so.
    #[must_use]
    pub const fn until(stop: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self { stop, progress: None, join: None }
    }

    /// Tells how much is done, and asks whether to go on.
    ///
    /// # Errors
    /// Where the answer is no.
    pub fn check(&self, done: f64) -> Result<(), Stopped> {
        if let Some(progress) = self.progress {
            progress(done);
        }
        if (self.stop)() { Err(Stopped) } else { Ok(()) }
    }
}

impl std::fmt::Debug for Control<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Control").finish_non_exhaustive()
    }
}
