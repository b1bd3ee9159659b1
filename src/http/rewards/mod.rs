//! Rewards: synchronous grading for trainers.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod adapters;
pub mod batch;
mod batch_items;
pub mod single;
pub mod structure;
