//! Hidden evaluation: epochs, entries, draws, instances, boards and receipts, with the rules that decide on them.

pub mod acceptance;
pub mod allocation;
pub mod answer;
pub mod boards;
pub mod body;
pub mod budget;
pub mod completion;
pub mod cosignatures;
pub mod draw;
pub mod draws;
pub mod entries;
pub mod epochs;
#[cfg(test)]
mod fixtures;
pub mod instances;
pub mod log;
pub mod pools;
pub mod receipts;
pub mod registration;
pub mod siblings;
