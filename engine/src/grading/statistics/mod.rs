//! Statistics of boards: how sure a rate is, whether two runs differ, and which places a run may have.

pub mod comparison;
pub mod interval;
pub mod ranks;

/// How often a statement may be wrong that is made of something which is not so.
pub const ALPHA: f64 = 0.05;
