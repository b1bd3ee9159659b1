//! Selects the specifications that an entry receives; neither the service nor the entrant can choose them.
//!
//! The seed is the HMAC-SHA256 under the epoch's key over entry, nonce, family, run and index. The service commits to
//! its key before it sees the nonce, and the entrant does not know the key. The seed selects a position in the family's
//! stratum of the pool. The draw takes the first specification from that position on (wrapping around) that was not
//! issued yet, so each is issued at most once in an epoch.

use super::pool::Stratum;
use super::secret::{EpochKey, first_number};

/// The input of a draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draw<'a> {
    /// Identifier of the entry.
    pub entry: &'a str,
    /// The entrant's nonce.
    pub nonce: &'a str,
    /// Number of the entry's run, from 1.
    pub run: u32,
    /// Index among the family's instances in the run, from 0.
    pub index: u32,
}

/// Returns the leaf that a draw takes, skipping the leaves for which `is_issued` is true, or `None` if all are issued.
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

    /// Entry, nonce and key each change the position; over many draws, each of them alone reaches every position.
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
