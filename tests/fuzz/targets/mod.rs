//! What is fuzzed: each target takes any bytes, and panics if something does not hold.

mod answer;
mod canonical;
pub mod check;
mod child;
mod command;
mod family;
mod log;
mod posted;
mod proofs;
mod query;
mod replay;
mod request;
mod structure_file;
mod task_file;
mod twins;

/// A target.
pub type Target = fn(&[u8]);

/// All targets by their names.
pub const ALL: [(&str, Target); 14] = [
    ("answer", answer::run),
    ("canonical", canonical::run),
    ("check", check::run),
    ("child", child::run),
    ("command", command::run),
    ("family", family::run),
    ("log", log::run),
    ("posted", posted::run),
    ("proofs", proofs::run),
    ("query", query::run),
    ("replay", replay::run),
    ("request", request::run),
    ("structure_file", structure_file::run),
    ("task_file", task_file::run),
];
