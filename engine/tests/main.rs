//! Tests of the engine as a whole, in one binary; what one file does is tested beside it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod degenerate;
mod draws;
mod fair;
mod gaming;
mod gauge;
mod hidden_checks;
mod panel;
mod scale;
mod search;
mod standing;
mod stress;
mod stress_plainly;
mod suite;
mod verdicts;

/// A file of the repository.
fn repository(path: &str) -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
