//! Elasticity: von Mises stress of a structure under its own weight (`docs/rules.md#stress`; paper, appendix "Von Mises
//! Stress").
//!
//! This module's README.md describes the methods, units, sources and verification.

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

/// Error of a computation that its control stopped early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the end")]
pub struct Stopped;

/// Function that runs two jobs, in parallel where that is faster, and returns when both are done.
pub type Join<'a> = dyn Fn(&mut (dyn FnMut() + Send), &mut (dyn FnMut() + Send)) + Sync + 'a;

/// Control over a long computation: progress, cancellation and additional cores. This module starts no threads itself.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Polled regularly; returning true stops the computation.
    pub stop: &'a (dyn Fn() -> bool + Sync),
    /// Called regularly with the fraction that is done, from 0 to 1.
    pub progress: Option<&'a (dyn Fn(f64) + Sync)>,
    /// Runs parts of the computation for large structures on other cores; results do not depend on it.
    pub join: Option<&'a Join<'a>>,
}

impl<'a> Control<'a> {
    /// Returns a control that runs the computation to completion on one core.
    #[must_use]
    pub const fn unhurried() -> Self {
        Self { stop: &|| false, progress: None, join: None }
    }

    /// Returns a control that runs the computation on one core until `stop` returns true.
    #[must_use]
    pub const fn until(stop: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self { stop, progress: None, join: None }
    }

    /// Runs two jobs, on two cores if the caller lends them.
    pub(crate) fn both(&self, first: impl FnOnce() + Send, second: impl FnOnce() + Send) {
        let Some(join) = self.join else {
            first();
            return second();
        };
        let (mut first, mut second) = (Some(first), Some(second));
        join(&mut || first.take().into_iter().for_each(|job| job()), &mut || {
            second.take().into_iter().for_each(|job| job());
        });
    }

    /// Reports the fraction that is done, and polls the stop signal.
    ///
    /// # Errors
    /// Returns an error if the computation is to stop.
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

#[cfg(test)]
mod tests {
    /// Runs two jobs on two threads: a [`super::Join`].
    pub(super) fn on_two_threads(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
        std::thread::scope(|scope| {
            scope.spawn(second);
            first();
        });
    }
}
