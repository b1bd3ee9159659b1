//! The families of the hidden suite, embedded in the binary from `tasks/hidden/` and `tasks/hidden-2/` at build time.

use rust_embed::RustEmbed;

use super::embedded::read_source;
use super::family::SuiteSource;
use super::published::TaskFileFault;

/// Families of version 1.
#[derive(RustEmbed)]
#[folder = "../tasks/hidden/"]
struct FirstFiles;

/// Families of version 2.
#[derive(RustEmbed)]
#[folder = "../tasks/hidden-2/"]
struct SecondFiles;

/// Reads the embedded files of a version of the hidden suite: version 1, or the latest for any other number.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn source(version: u32) -> Result<SuiteSource, Vec<TaskFileFault>> {
    if version == 1 { read_source::<FirstFiles>() } else { read_source::<SecondFiles>() }
}
