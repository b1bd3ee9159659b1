//! Runs: creating, reading, finishing and deleting attempts at a suite.

pub mod body;
pub mod changes;
pub mod create;
pub mod embargo;
pub mod publicity;
pub mod read;
pub mod results;
