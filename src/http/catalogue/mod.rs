//! The catalogue: suites and their tasks.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod datasets;
pub mod suites;
pub mod tasks;
