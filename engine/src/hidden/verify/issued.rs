//! The specifications that the instances of an epoch have.

use std::collections::BTreeMap;

use crate::hidden::commitment::Commitment;
use crate::hidden::pool::{PoolError, Specification};
use crate::hidden::reveal::Reveal;
use crate::hidden::siblings::Siblings;

/// The specifications behind the leaves of an epoch: the revealed ones, and the public list of siblings.
pub(super) struct Issued<'a> {
    commitment: &'a Commitment,
    revealed: BTreeMap<u32, &'a Specification>,
    /// The list of siblings, if the epoch has any.
    pub siblings: Option<&'static Siblings>,
}

impl<'a> Issued<'a> {
    /// Collects the specifications.
    ///
    /// # Errors
    /// Returns an error if this program's own families are faulty.
    pub fn of(reveal: &'a Reveal, commitment: &'a Commitment) -> Result<Self, PoolError> {
        let siblings = commitment.siblings.as_ref().map(|_| Siblings::of(commitment.generator_version)).transpose()?;
        let own = reveal.specifications.iter().map(|own| (own.specification.leaf, &own.specification));
        Ok(Self { commitment, revealed: own.collect(), siblings })
    }

    /// Returns the specification behind a leaf.
    pub fn specification(&self, leaf: u32) -> Option<&Specification> {
        if self.commitment.is_sibling(leaf) {
            return self.siblings?.specification(self.commitment, leaf);
        }
        self.revealed.get(&leaf).copied()
    }
}
