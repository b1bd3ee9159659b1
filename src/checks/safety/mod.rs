//! Safety: physical plausibility and structural stability.

pub mod plausibility;
pub mod stability;
