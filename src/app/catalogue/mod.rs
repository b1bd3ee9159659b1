//! The catalogue: suites and their tasks.

pub mod suites;
pub mod tasks;
