//! The families of the hidden suite inside the binary: the files of `tasks/hidden/` at build time.

use rust_embed::RustEmbed;

use super::embedded::read_source;
use super::family::SuiteSource;
use super::published::TaskFileFault;

#[derive(RustEmbed)]
#[folder = "../tasks/hidden/"]
struct Files;

/// The files of the hidden suite.
///
/// # Errors
/// Faults of the files; a test shows that there are none.
pub fn source() -> Result<SuiteSource, Vec<TaskFileFault>> {
    read_source::<Files>()
}
