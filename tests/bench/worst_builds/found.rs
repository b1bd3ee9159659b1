//! The file of the slowest builds that were found.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use super::strokes::Stroke;

/// Greatest number of blocks of the small builds.
pub const SMALL: usize = 2_000;

/// The slowest builds that were found for a check: of few blocks, and of as many as a log may have.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Found {
    pub small: Vec<Stroke>,
    pub large: Vec<Stroke>,
}

pub fn file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/bench/worst_builds/found.json")
}

/// Reads the file: builds by the names of the checks.
pub fn read() -> anyhow::Result<BTreeMap<String, Found>> {
    let text = std::fs::read_to_string(file()).with_context(|| file().display().to_string())?;
    Ok(serde_json::from_str(&text)?)
}
