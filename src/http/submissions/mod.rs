//! Submissions: posting, reading, cancelling; their reports, logs and stress fields; replay of action code.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod body;
pub mod create;
pub mod replay;
pub mod reports;
pub mod resource;
pub mod stress;
pub mod structure;
