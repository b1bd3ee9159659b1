//! Public siblings of hidden instances: specifications of the same families with parameters from the same ranges, which
//! anybody can list from this program alone, whatever epochs there are.
//!
//! An agent that has learned the list by heart solves siblings and fails their hidden counterparts; one that can build
//! solves both alike. The difference is the [`gauge`](super::gauge).

use std::collections::BTreeMap;
use std::io::Read as _;
use std::sync::OnceLock;

use flate2::read::GzDecoder;
use sha2::{Digest as _, Sha256};

use super::GENERATOR_VERSION;
use super::canonical::{Hash, canonical_json};
use super::commitment::{Commitment, SiblingList};
use super::merkle;
use super::pool::{Generator, PoolError, Specification, Stratum, strata_of, suite_of};
use super::secret::EpochKey;
use super::tlog::tree::leaf;
use crate::tasks::{hex, hidden};

/// First version of the generator whose epochs draw siblings. It draws no hidden instance that is on their list.
pub const FIRST_WITH_SIBLINGS: u32 = 3;
/// Number of versions of the generator that draw siblings.
pub(super) const WITH_SIBLINGS: usize = (GENERATOR_VERSION - FIRST_WITH_SIBLINGS + 1) as usize;
/// Number of specifications in the list of siblings for each instance of a family in a draw.
const PER_INSTANCE: u32 = 64;

/// The lists as lines of canonical JSON in gzip, by version from [`FIRST_WITH_SIBLINGS`] on. To draw one takes seconds of
/// each program that verifies an epoch; a test draws them and compares.
const STORED: [&[u8]; WITH_SIBLINGS] =
    [include_bytes!("../../../tasks/siblings/3.jsonl.gz"), include_bytes!("../../../tasks/siblings/4.jsonl.gz")];

/// The list of siblings of a version of the generator.
#[derive(Debug)]
pub struct Siblings {
    specifications: Vec<Specification>,
    /// Lines of canonical JSON (RFC 8785), one for each specification.
    lines: String,
    strata: BTreeMap<String, Stratum>,
    list: SiblingList,
}

impl Siblings {
    /// Returns the list of a version of the generator. A program reads each once.
    ///
    /// # Errors
    /// Returns an error if the version draws no siblings, or the embedded files are faulty; a test shows that they are
    /// not.
    pub fn of(version: u32) -> Result<&'static Self, PoolError> {
        static READ: [OnceLock<Siblings>; WITH_SIBLINGS] = [const { OnceLock::new() }; _];
        let index = index_of(version)?;
        let place = &READ[index];
        if let Some(read) = place.get() {
            return Ok(read);
        }
        // Callers that come at once may each read it, which takes a tenth of a second; all get the same one.
        let read =
            Self::read(STORED[index], suite_of(version)?).map_err(|fault| PoolError::Files(fault.to_string()))?;
        Ok(place.get_or_init(|| read))
    }

    /// Reads a stored list.
    fn read(stored: &[u8], suite: u32) -> std::io::Result<Self> {
        let mut lines = String::new();
        GzDecoder::new(stored).read_to_string(&mut lines)?;
        let specifications = lines.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
        let families = hidden::source(suite).map_err(|faults| std::io::Error::other(format!("{faults:?}")))?.families;
        let strata = strata_of(families.iter(), PER_INSTANCE);
        Ok(Self::with_root(specifications, lines, strata))
    }

    /// Draws the list of a version of the generator anew, which takes seconds: anybody can.
    ///
    /// # Errors
    /// Returns the same errors as [`of`](Self::of).
    pub fn draw(version: u32) -> Result<Self, PoolError> {
        index_of(version)?;
        // The key is no secret.
        let key = EpochKey::new(Sha256::digest(b"plumbline public siblings").into());
        let generator = Generator::of_suite(suite_of(version)?)?;
        let strata = strata_of(generator.families().iter(), PER_INSTANCE);
        let mut specifications = Vec::new();
        for stratum in &strata {
            specifications.extend(generator.specifications(&key, stratum, &|| ())?);
        }
        for own in &mut specifications {
            // Hidden specifications have the same numbers; the id tells them apart.
            own.task.id = format!("{}/sibling-{:05}", own.task.family(), own.leaf);
        }
        let line = |own| String::from_utf8(canonical_json(own)).expect("JSON is text") + "\n";
        let lines = specifications.iter().map(line).collect();
        Ok(Self::with_root(specifications, lines, strata))
    }

    fn with_root(specifications: Vec<Specification>, lines: String, strata: Vec<Stratum>) -> Self {
        let leaves: Vec<Hash> = lines.lines().map(|line| leaf(line.as_bytes())).collect();
        let root = hex(&merkle::root(&leaves));
        let list = SiblingList { specifications: specifications.len() as u32, root };
        let strata = strata.into_iter().map(|own| (own.family.clone(), own)).collect();
        Self { specifications, lines, strata, list }
    }

    /// Returns all specifications, by leaf of the list.
    #[must_use]
    pub fn specifications(&self) -> &[Specification] {
        &self.specifications
    }

    /// Returns the list as lines of canonical JSON (RFC 8785), whose hashes give the root.
    #[must_use]
    pub fn lines(&self) -> &str {
        &self.lines
    }

    /// Returns what a commitment says of the list.
    #[must_use]
    pub const fn list(&self) -> &SiblingList {
        &self.list
    }

    /// Returns the part of the list that belongs to a family.
    #[must_use]
    pub fn stratum(&self, family: &str) -> Option<&Stratum> {
        self.strata.get(family)
    }

    /// Returns the specification behind a leaf that an epoch has issued, or `None` if it is one of the pool.
    #[must_use]
    pub fn specification(&self, commitment: &Commitment, leaf: u32) -> Option<&Specification> {
        let leaf = leaf.checked_sub(commitment.specifications)? % self.list.specifications;
        self.specifications.get(leaf as usize)
    }
}

/// Returns the place of a version in lists of those that draw siblings.
fn index_of(version: u32) -> Result<usize, PoolError> {
    let none = || PoolError::Files(format!("version {version} of the generator draws no siblings"));
    let index = version.checked_sub(FIRST_WITH_SIBLINGS).map(|index| index as usize);
    index.filter(|index| *index < WITH_SIBLINGS).ok_or_else(none)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn each_stored_list_is_what_the_generator_draws() {
        for version in FIRST_WITH_SIBLINGS..=GENERATOR_VERSION {
            let (drawn, stored) = (Siblings::draw(version).unwrap(), Siblings::of(version).unwrap());
            let remedy = "see CONTRIBUTING.md, \"Add a hidden family\"";
            assert_eq!(drawn.list(), stored.list(), "tasks/siblings/{version}.jsonl.gz is another list; {remedy}");
            assert!(drawn.specifications() == stored.specifications(), "the stored list is not read as it was written");
            assert_eq!(drawn.strata, stored.strata);
        }
        assert!(Siblings::of(FIRST_WITH_SIBLINGS - 1).is_err() && Siblings::draw(GENERATOR_VERSION + 1).is_err());
    }

    #[test]
    fn no_sibling_returns_as_a_hidden_instance() {
        let named = |own: &Specification| {
            [format!("{}{:?}", own.task.family(), own.task.parameters), format!("{:?}", own.task.turns)]
        };
        let list = Siblings::of(GENERATOR_VERSION).unwrap().specifications.iter();
        let known: BTreeSet<String> = list.flat_map(named).collect();
        let key = EpochKey::new([9; 32]);
        let known_in = |version| {
            let generator = Generator::of(version).unwrap();
            let strata = generator.strata(&key, 16).into_iter();
            let drawn = strata.flat_map(|stratum| generator.specifications(&key, &stratum, &|| ()).unwrap());
            drawn.filter(|own| named(own).iter().any(|mark| known.contains(mark))).count()
        };
        assert!(known_in(FIRST_WITH_SIBLINGS - 1) > 0, "the generator before does not know the list");
        assert_eq!(known_in(GENERATOR_VERSION), 0);
    }

    #[test]
    fn the_list_has_every_family_and_no_specification_twice() {
        let generator = Generator::new().unwrap();
        let siblings = Siblings::of(GENERATOR_VERSION).unwrap();
        for family in generator.families() {
            let own = &siblings.strata[family.name()];
            let of_family = &siblings.specifications[own.first as usize..(own.first + own.size) as usize];
            assert!(own.size >= 64 && of_family.iter().all(|one| one.task.family() == family.name()));
        }
        let prompts: BTreeSet<String> =
            siblings.specifications.iter().map(|own| format!("{:?}", own.task.turns)).collect();
        assert_eq!(prompts.len(), siblings.specifications.len());
        assert_eq!(siblings.list.specifications as usize, siblings.specifications.len());
    }
}
