//! Runs: creating, reading, finishing and deleting attempts at a suite.

pub mod changes;
pub mod create;
pub mod provenance;
pub mod read;
pub mod results;
