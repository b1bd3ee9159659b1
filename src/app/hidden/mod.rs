//! Hidden evaluation: answers to instances.

pub mod answer;
