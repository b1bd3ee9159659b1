//! A Merkle tree that grows (RFC 6962, section 2.1), with the hashes of all complete subtrees at hand.

use sha2::{Digest as _, Sha256};

use crate::hidden::canonical::Hash;
use crate::hidden::merkle::{node, split};

/// Computes the hash of an entry's leaf.
#[must_use]
pub fn leaf(entry: &[u8]) -> Hash {
    Sha256::new().chain_update([0]).chain_update(entry).finalize().into()
}

/// A tree that grows. It holds two hashes for each leaf.
#[derive(Debug, Clone, Default)]
pub struct Tree {
    /// For each level, the roots of the complete subtrees of `2^level` leaves, from the left.
    levels: Vec<Vec<Hash>>,
}

impl Tree {
    /// Returns the number of leaves.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.levels.first().map_or(0, |leaves| leaves.len() as u64)
    }

    /// Returns whether the tree has no leaf.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends a leaf.
    pub fn push(&mut self, leaf: Hash) {
        let mut hash = leaf;
        for level in 0.. {
            if self.levels.len() == level {
                self.levels.push(Vec::new());
            }
            let row = &mut self.levels[level];
            row.push(hash);
            // A right child completes its parent.
            let [.., left, right] = row.as_slice() else { return };
            if row.len() % 2 == 1 {
                return;
            }
            hash = node(left, right);
        }
    }

    /// Returns the roots of complete subtrees of `2^level` leaves, from one of them on; `None` if there are not so
    /// many.
    #[must_use]
    pub fn row(&self, level: usize, from: u64, count: usize) -> Option<&[Hash]> {
        let row = self.levels.get(level)?;
        let from = usize::try_from(from).ok()?;
        row.get(from..from.checked_add(count)?)
    }

    /// Returns the root of the tree as it was with the first `size` leaves; `None` if it has fewer.
    #[must_use]
    pub fn root(&self, size: u64) -> Option<Hash> {
        match size {
            0 => Some(Sha256::digest([]).into()),
            size => (size <= self.len()).then(|| self.range(0, size)),
        }
    }

    /// Returns the proof that a leaf is in the tree of the first `size` leaves, from the leaf up; `None` if it is not.
    #[must_use]
    pub fn inclusion(&self, index: u64, size: u64) -> Option<Vec<Hash>> {
        if index >= size || size > self.len() {
            return None;
        }
        let mut proof = Vec::new();
        let (mut low, mut high) = (0, size);
        while high - low > 1 {
            let middle = low + split(high - low);
            if index < middle {
                proof.push(self.range(middle, high));
                high = middle;
            } else {
                proof.push(self.range(low, middle));
                low = middle;
            }
        }
        proof.reverse();
        Some(proof)
    }

    /// Returns the proof that the tree of the first `size` leaves begins with that of the first `old`; `None` if it has
    /// fewer. The service needs no such proofs; see [`is_consistent`](super::proof::is_consistent).
    #[must_use]
    pub fn consistency(&self, old: u64, size: u64) -> Option<Vec<Hash>> {
        if old > size || size > self.len() {
            return None;
        }
        if old == 0 || old == size {
            return Some(Vec::new());
        }
        let mut proof = Vec::new();
        let (mut low, mut high) = (0, size);
        // Down to the subtree that ends where the old tree ends.
        while high != old {
            let middle = low + split(high - low);
            if old <= middle {
                proof.push(self.range(middle, high));
                high = middle;
            } else {
                proof.push(self.range(low, middle));
                low = middle;
            }
        }
        // Whoever asks knows the root of the old tree if that subtree is all of it.
        if low > 0 {
            proof.push(self.range(low, high));
        }
        proof.reverse();
        Some(proof)
    }

    /// Computes the root over a range of leaves. Its beginning is a multiple of the greatest power of two within its
    /// length.
    fn range(&self, low: u64, high: u64) -> Hash {
        let length = high - low;
        if length.is_power_of_two() {
            let level = length.trailing_zeros();
            let row = &self.levels[level as usize];
            return row[usize::try_from(low >> level).expect("a tree in memory has fewer leaves than addresses")];
        }
        let middle = low + split(length);
        node(&self.range(low, middle), &self.range(middle, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::merkle;

    #[test]
    fn roots_are_those_of_the_plain_rule() {
        let mut tree = Tree::default();
        let leaves: Vec<Hash> = (0..130_u32).map(|i| leaf(&i.to_be_bytes())).collect();
        for (size, own) in (1..).zip(&leaves) {
            tree.push(*own);
            assert_eq!(tree.len(), size as u64);
            assert_eq!(tree.root(size as u64), Some(merkle::root(&leaves[..size])), "{size}");
        }
        assert_eq!(tree.root(0), Some(merkle::root(&[])));
        assert_eq!(tree.root(131), None);
        assert_eq!(split(2), 1);
        assert_eq!([split(3), split(4), split(5), split(257)], [2, 2, 4, 256]);
    }
}
