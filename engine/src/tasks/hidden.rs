//! The families of the hidden suite, embedded in the binary from `tasks/hidden/`, `tasks/hidden-2/` and
//! `tasks/hidden-3/` at build time.

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

/// Families of version 3.
#[derive(RustEmbed)]
#[folder = "../tasks/hidden-3/"]
struct ThirdFiles;

/// Latest version of the hidden suite. Version 1 stands beside version 2 of the public suite, version 2 beside version 3,
/// and version 3 beside version 4.
pub const LATEST: u32 = 3;

/// Reads the embedded files of a version of the hidden suite: version 1, 2, or the latest for any other number.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn source(version: u32) -> Result<SuiteSource, Vec<TaskFileFault>> {
    match version {
        1 => read_source::<FirstFiles>(),
        2 => read_source::<SecondFiles>(),
        _ => read_source::<ThirdFiles>(),
    }
}
