//! Elasticity: von Mises stress of a structure under its own weight (SPEC 4; paper, appendix "Von Mises Stress").
//!
//! Method, units, sources and verification are told in this room's README.md.

mod constitutive;
pub mod neighbours;
mod pairs;
pub mod small_matrix;
pub mod sph;

/// A computation ended early because it was asked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the end")]
pub struct Stopped;
