//! The families of the hidden suite, embedded in the binary from `tasks/hidden/` at build time.

use rust_embed::RustEmbed;

use super::embedded::read_source;
use super::family::SuiteSource;
use super::published::TaskFileFault;

#[derive(RustEmbed)]
#[folder = "../tasks/hidden/"]
struct Files;

/// Reads the embedded files of the hidden suite.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn source() -> Result<SuiteSource, Vec<TaskFileFault>> {
    read_source::<Files>()
}
