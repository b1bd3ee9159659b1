//! The versions of the generator: the suite that each draws from, and the specifications that it does not draw.

use std::sync::OnceLock;

use super::GENERATOR_VERSION;
use super::pool::{Generator, PoolError, suite_of};
use super::siblings::{FIRST_WITH_SIBLINGS, Siblings, WITH_SIBLINGS};

impl Generator {
    /// Returns the latest version of the generator.
    ///
    /// # Errors
    /// Returns an error if the embedded files are faulty; a test shows that they are not.
    pub fn new() -> Result<&'static Self, PoolError> {
        Self::of(GENERATOR_VERSION)
    }

    /// Returns a version of the generator. A program creates each once, which builds the public suites.
    ///
    /// # Errors
    /// Returns an error if there is no such version, or the embedded files are faulty; a test shows that they are not.
    pub fn of(version: u32) -> Result<&'static Self, PoolError> {
        static CREATED: [OnceLock<Generator>; WITH_SIBLINGS] = [const { OnceLock::new() }; _];
        let suite = suite_of(version)?;
        let Some(place) = version.checked_sub(FIRST_WITH_SIBLINGS) else { return Self::of_suite(suite) };
        let place = &CREATED[place as usize];
        if let Some(created) = place.get() {
            return Ok(created);
        }
        // No sibling returns as a hidden instance. Both are then drawn alike, without replacement.
        let created = Self::create(suite, Siblings::of(version)?.specifications())?;
        Ok(place.get_or_init(|| created))
    }
}
