//! The versions of the generator: the suite that each draws from, and the specifications that it does not draw.

use std::sync::OnceLock;

use super::GENERATOR_VERSION;
use super::pool::{Generator, LATEST_SUITE, PoolError};
use super::siblings::{FIRST_WITH_SIBLINGS, Siblings};

impl Generator {
    /// Returns the latest version of the generator.
    ///
    /// # Errors
    /// Returns an error if the embedded files are faulty; a test shows that they are not.
    pub fn new() -> Result<&'static Self, PoolError> {
        Self::of(GENERATOR_VERSION)
    }

    /// Returns a version of the generator. A program creates each once, which builds the public suites and, for versions
    /// that draw siblings, their list.
    ///
    /// # Errors
    /// Returns an error if there is no such version, or the embedded files are faulty; a test shows that they are not.
    pub fn of(version: u32) -> Result<&'static Self, PoolError> {
        static LATEST: OnceLock<Generator> = OnceLock::new();
        if version < FIRST_WITH_SIBLINGS {
            return Self::of_suite(version);
        }
        if version != GENERATOR_VERSION {
            return Err(PoolError::Files(format!("there is no version {version} of the generator")));
        }
        if let Some(created) = LATEST.get() {
            return Ok(created);
        }
        // No sibling returns as a hidden instance. Both are then drawn alike, without replacement.
        let created = Self::create(LATEST_SUITE, Siblings::of(version)?.specifications())?;
        Ok(LATEST.get_or_init(|| created))
    }
}
