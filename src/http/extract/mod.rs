//! Extractors: bodies, callers, parameters, and the headers that repeat or spare an answer.

pub mod body;
pub mod caller;
pub mod conditional;
pub mod idempotency;
pub mod params;
