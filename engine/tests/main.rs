//! Tests of the engine as a whole, in one binary; what one file does is tested beside it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod degenerate;
mod draws;
mod gaming;
mod gauge;
mod hidden_checks;
mod panel;
mod scale;
mod smallest_passing;
mod stress;
mod stress_plainly;
mod suite;
mod verdicts;
mod version_3;
mod version_4;

/// A file of the repository.
fn repository(path: &str) -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
