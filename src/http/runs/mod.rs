//! Runs: an agent's attempts at a suite.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod cards;
pub mod changes;
pub mod publicity;
pub mod resource;
