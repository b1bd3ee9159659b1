//! Extractors: bodies, callers, query parameters, idempotency keys and conditional requests.

pub mod body;
pub mod caller;
pub mod conditional;
pub mod idempotency;
pub mod origin;
pub mod params;
pub mod room;
