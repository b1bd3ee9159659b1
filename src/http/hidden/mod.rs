//! Hidden evaluation: epochs, entries, draws, instances, boards and receipts.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod boards;
pub mod draws;
pub mod entries;
pub mod epochs;
pub mod instances;
pub mod log;
pub mod receipts;
pub mod siblings;
