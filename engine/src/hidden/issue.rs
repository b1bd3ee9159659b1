//! Selects the specifications that an entry receives; neither the service nor the entrant can choose them.
//!
//! The lot of a run follows from the epoch's key, the entry, the run and the entrant's nonce. The service commits to
//! its key before it sees the nonce, and the entrant does not know the key. For each family and index, the lot selects
//! a position in the family's stratum of the pool. The draw takes the first specification from that position on
//! (wrapping around) that was not issued yet, so each is issued at most once in an epoch.

use std::collections::HashSet;

use sha2::{Digest as _, Sha256};

use super::canonical::Hash;
use super::commitment::Commitment;
use super::draw_proof::{DrawMessage, OUTPUT_BYTES, Output, prove};
use super::feedback::Tier;
use super::pool::Stratum;
use super::secret::{EpochKey, first_number};
use super::siblings::Siblings;

/// What a run draws with.
#[derive(Debug, Clone)]
pub enum Lot<'a> {
    /// HMAC-SHA256 under the epoch's key, in epochs from before proofs: it can be checked only after the reveal.
    Keyed {
        /// Key of the epoch.
        key: &'a EpochKey,
        /// Identifier of the entry.
        entry: &'a str,
        /// The entrant's nonce.
        nonce: &'a str,
        /// Number of the entry's run, from 1.
        run: u32,
    },
    /// Output of a verifiable random function, whose proof the entrant gets with the draw.
    Proven {
        /// The output.
        output: Output,
        /// Its proof, in hexadecimal.
        proof: String,
    },
}

impl<'a> Lot<'a> {
    /// Returns the lot of a run, as the epoch has committed to.
    #[must_use]
    pub fn of(commitment: &Commitment, key: &'a EpochKey, entry: &'a str, run: u32, nonce: &'a str) -> Self {
        if commitment.draw_key.is_none() {
            return Self::Keyed { key, entry, nonce, run };
        }
        let (output, proof) = prove(key, &DrawMessage { epoch: &commitment.epoch, entry, run, nonce });
        Self::Proven { output, proof }
    }

    /// Returns the proof, if the lot has one.
    #[must_use]
    pub fn proof(&self) -> Option<&str> {
        match self {
            Self::Keyed { .. } => None,
            Self::Proven { proof, .. } => Some(proof),
        }
    }

    /// Returns the leaf that the run takes for this index among the family's instances, from 0. It skips the leaves for
    /// which
    /// `is_issued` is true, and is `None` if all are issued.
    #[must_use]
    pub fn leaf(&self, stratum: &Stratum, index: u32, is_issued: impl Fn(u32) -> bool) -> Option<u32> {
        let from = self.position(stratum, index);
        let places = (from..stratum.size).chain(0..from);
        places.map(|place| stratum.first + place).find(|leaf| !is_issued(*leaf))
    }

    fn position(&self, stratum: &Stratum, index: u32) -> u32 {
        let number = match self {
            Self::Keyed { key, entry, nonce, run } => {
                let (run, index) = (run.to_be_bytes(), index.to_be_bytes());
                let parts = [entry.as_bytes(), nonce.as_bytes(), stratum.family.as_bytes(), &run, &index];
                first_number(&key.derive("draw", &parts))
            }
            Self::Proven { output, .. } => first_number(&ticket(output, &stratum.family, index)),
        };
        (number % u64::from(stratum.size.max(1))) as u32
    }
}

/// Returns the hash of an output for one instance. Its first eight bytes, as a big-endian number, modulo the size of
/// the stratum are the position.
fn ticket(output: &[u8; OUTPUT_BYTES], family: &str, index: u32) -> Hash {
    let label = Sha256::new().chain_update(b"plumbline position\0").chain_update(output);
    label.chain_update(index.to_be_bytes()).chain_update(family.as_bytes()).finalize().into()
}

/// What a run draws for one instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Stratum of the pool, or of the list of siblings.
    pub stratum: Stratum,
    /// Index among the family's instances in the run, from 0; a sibling has that of its instance plus their number.
    pub index: u32,
    /// Whether a sibling is drawn.
    pub is_sibling: bool,
}

/// What an epoch draws from.
#[derive(Debug, Clone, Copy)]
pub struct Drawing<'a> {
    /// Commitment of the epoch.
    pub commitment: &'a Commitment,
    /// Strata of its pool.
    pub strata: &'a [Stratum],
    /// Its list of siblings, if it has one.
    pub siblings: Option<&'static Siblings>,
}

impl Drawing<'_> {
    /// Returns what a run of a tier draws, in order: for each family its instances and, in the official tier, their
    /// siblings.
    #[must_use]
    pub fn places(&self, tier: Tier) -> Vec<Place> {
        let siblings = self.siblings.filter(|_| tier == Tier::Official);
        let of_family = |own: &Stratum| {
            let place = |stratum: &Stratum, index, is_sibling| Place { stratum: stratum.clone(), index, is_sibling };
            let mut places: Vec<Place> = (0..own.instances).map(|index| place(own, index, false)).collect();
            if let Some(public) = siblings.and_then(|list| list.stratum(&own.family)) {
                places.extend((own.instances..2 * own.instances).map(|index| place(public, index, true)));
            }
            places
        };
        self.strata.iter().flat_map(of_family).collect()
    }

    /// Returns the leaf that a lot takes for a place, or `None` if all are issued: `issued` are the leaves that the
    /// epoch has issued, `of_entry` those among them that the same entry has.
    ///
    /// A sibling is public, and more than one entry may have it. Its leaf is the number of specifications in the pool,
    /// plus its leaf in the list, plus the length of the list for each time that it was issued before. So which sibling
    /// an entry gets does not tell what others have.
    #[must_use]
    pub fn leaf(&self, lot: &Lot<'_>, place: &Place, issued: &HashSet<u32>, of_entry: &HashSet<u32>) -> Option<u32> {
        if !place.is_sibling {
            return lot.leaf(&place.stratum, place.index, |leaf| issued.contains(&leaf));
        }
        let (first, length) = (self.commitment.specifications, self.siblings?.list().specifications);
        let listed = |leaf: &u32| leaf.checked_sub(first).map(|own| own % length);
        let taken: HashSet<u32> = of_entry.iter().filter_map(listed).collect();
        let own = lot.leaf(&place.stratum, place.index, |leaf| taken.contains(&leaf))?;
        let mut leaf = first.checked_add(own)?;
        while issued.contains(&leaf) {
            leaf = leaf.checked_add(length)?;
        }
        Some(leaf)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn stratum() -> Stratum {
        Stratum { family: "slabs".to_owned(), instances: 1, first: 10, size: 5 }
    }

    /// The lots of both kinds.
    fn lots<'a>(key: &'a EpochKey, entry: &'a str, nonce: &'a str, run: u32) -> [Lot<'a>; 2] {
        let (output, proof) = prove(key, &DrawMessage { epoch: "autumn", entry, run, nonce });
        [Lot::Keyed { key, entry, nonce, run }, Lot::Proven { output, proof }]
    }

    #[test]
    fn each_leaf_is_issued_once_until_none_is_left() {
        let key = EpochKey::new([3; 32]);
        for lot in lots(&key, "e", "n", 1) {
            let mut issued = BTreeSet::new();
            for index in 0..5 {
                let leaf = lot.leaf(&stratum(), index, |leaf| issued.contains(&leaf)).unwrap();
                assert!((10..15).contains(&leaf) && issued.insert(leaf));
            }
            assert_eq!(lot.leaf(&stratum(), 0, |leaf| issued.contains(&leaf)), None);
        }
    }

    /// Entry, nonce, run and key each change the position; over many draws, each of them alone reaches every position.
    #[test]
    fn neither_side_alone_decides() {
        for kind in 0..2 {
            let take = |key: u8, entry: &str, nonce: &str, run: u32| {
                lots(&EpochKey::new([key; 32]), entry, nonce, run)[kind].leaf(&stratum(), 0, |_| false).unwrap()
            };
            let nonces: BTreeSet<u32> = (0..100).map(|i| take(1, "e", &i.to_string(), 1)).collect();
            let keys: BTreeSet<u32> = (0..100).map(|i| take(i, "e", "n", 1)).collect();
            let entries: BTreeSet<u32> = (0..100).map(|i| take(1, &i.to_string(), "n", 1)).collect();
            let runs: BTreeSet<u32> = (0..100).map(|i| take(1, "e", "n", i)).collect();
            assert!([nonces, keys, entries, runs].iter().all(|all| all.len() == 5), "{kind}");
        }
    }

    /// Epochs from before proofs are verified with the draw that they had: these leaves are of that program.
    #[test]
    fn draws_without_proofs_stay_as_they_were() {
        let key = EpochKey::new([3; 32]);
        let wide = Stratum { size: 1_000, ..stratum() };
        let lot = Lot::Keyed { key: &key, entry: "entry", nonce: "nonce", run: 2 };
        let leaves: Vec<u32> = (0..4).filter_map(|index| lot.leaf(&wide, index, |_| false)).collect();
        assert_eq!(leaves, [423, 398, 757, 334]);
    }
}
