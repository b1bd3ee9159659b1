//! Which specification an entry gets: neither the service nor the entrant can choose it.
//!
//! The seed is HMAC-SHA256 under the epoch's key over entry, nonce, family and index. The service is bound by its key, to which
//! it committed, before it sees the nonce; the entrant does not know the key. The seed names a place in the family's part of
//! the pool; the first specification from there on that was not issued yet is taken, so each is issued once in an epoch.

use super::pool::Stratum;
use super::secret::{EpochKey, first_number};

/// What a draw is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draw<'a> {
    /// Id of the entry.
    pub entry: &'a str,
    /// The entrant's nonce.
    pub nonce: &'a str,
    /// Which of the entry's runs, from 1.
    pub run: u32,
    /// Which of the family's instances in the run, from 0.
    pub index: u32,
}

/// The leaf that a draw takes, where `is_issued` tells which are gone; none where all are.
#[must_use]
pub fn leaf(key: &EpochKey, stratum: &Stratum, draw: &Draw<'_>, is_issued: impl Fn(u32) -> bool) -> Option<u32> {
    let (run, index) = (draw.run.to_be_bytes(), draw.index.to_be_bytes());
    let parts = [draw.entry.as_bytes(), draw.nonce.as_bytes(), stratum.family.as_bytes(), &run, &index];
    let from = (first_number(&key.derive("draw", &parts)) % u64::from(stratum.size.max(1))) as u32;
    let places = (from..stratum.size).chain(0..from);
    places.map(|place| stratum.first + place).find(|leaf| !is_issued(*leaf))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn stratum() -> Stratum {
        Stratum { family: "slabs".to_owned(), instances: 1, first: 10, size: 5 }
    }

    #[test]
    fn each_leaf_is_issued_once_until_none_is_left() {
        let (key, mut issued) = (EpochKey::new([3; 32]), BTreeSet::new());
        for index in 0..5 {
            let draw = Draw { entry: "e", nonce: "n", run: 1, index };
            let leaf = leaf(&key, &stratum(), &draw, |leaf| issued.contains(&leaf)).unwrap();
            assert!((10..15).contains(&leaf) && issued.insert(leaf));
        }
        let draw = Draw { entry: "e", nonce: "n", run: 2, index: 0 };
        assert_eq!(leaf(&key, &stratum(), &draw, |leaf| issued.contains(&leaf)), None);
    }

    /// Entry, nonce and key each move the place, over many draws to every place.
    #[test]
    fn neither_side_alone_decides() {
        let take = |key: u8, entry: &str, nonce: &str| {
            let draw = Draw { entry, nonce, run: 1, index: 0 };
            leaf(&EpochKey::new([key; 32]), &stratum(), &draw, |_| false).unwrap()
        };
        let nonces: BTreeSet<u32> = (0..100).map(|i| take(1, "e", &i.to_string())).collect();
        let keys: BTreeSet<u32> = (0..100).map(|i| take(i, "e", "n")).collect();
        let entries: BTreeSet<u32> = (0..100).map(|i| take(1, &i.to_string(), "n")).collect();
        assert!(nonces.len() == 5 && keys.len() == 5 && entries.len() == 5);
    }
}
