//! Statistics of boards: confidence intervals of rates, tests of whether runs differ, and ranges of ranks.

pub mod comparison;
pub mod interval;
pub mod ranks;

/// Significance level: the greatest probability of claiming a difference that does not exist.
pub const ALPHA: f64 = 0.05;
