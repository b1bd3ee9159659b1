//! Safety: physical plausibility and structural stability.

pub mod equilibrium;
pub mod figures;
pub mod plausibility;
pub mod stability;
