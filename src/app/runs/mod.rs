//! Runs: creating, reading, finishing and deleting attempts at a suite.

pub mod body;
pub mod changes;
pub mod create;
pub mod read;
pub mod results;
