//! Submissions from the body that arrives to the report.

mod bad_input;
mod cancel;
mod idempotency;
mod lifecycle;
