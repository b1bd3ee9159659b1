//! Merkle trees over hashes, as in RFC 6962: leaves and nodes are hashed with different prefixes, and a tree of any
//! size splits at the largest power of two smaller than its size.

use sha2::{Digest as _, Sha256};

use super::canonical::Hash;

/// Computes the hash of a leaf: SHA-256 over a zero byte, the salt and the content hash.
#[must_use]
pub fn leaf(salt: &Hash, content: &Hash) -> Hash {
    Sha256::new().chain_update([0]).chain_update(salt).chain_update(content).finalize().into()
}

/// Computes the hash of a node: SHA-256 over a one byte and the hashes of its children.
pub(super) fn node(left: &Hash, right: &Hash) -> Hash {
    Sha256::new().chain_update([1]).chain_update(left).chain_update(right).finalize().into()
}

/// Returns the greatest power of two that is smaller than a number above 1.
pub(super) const fn split(leaves: u64) -> u64 {
    1 << (leaves - 1).ilog2()
}

/// Computes the root over the leaves in order; without leaves, the SHA-256 of the empty string.
#[must_use]
pub fn root(leaves: &[Hash]) -> Hash {
    match leaves {
        [] => Sha256::digest([]).into(),
        [only] => *only,
        _ => {
            let (left, right) = leaves.split_at(split(leaves.len() as u64) as usize);
            node(&root(left), &root(right))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves(n: usize) -> Vec<Hash> {
        (0..n).map(|i| leaf(&[0; 32], &[i as u8; 32])).collect()
    }

    /// The tree of seven leaves from RFC 6962, section 2.1.3.
    #[test]
    fn seven_leaves_split_at_four() {
        let l = leaves(7);
        let left = node(&node(&l[0], &l[1]), &node(&l[2], &l[3]));
        let right = node(&node(&l[4], &l[5]), &l[6]);
        assert_eq!(root(&l), node(&left, &right));
        assert_eq!(root(&l[..1]), l[0]);
    }

    #[test]
    fn a_bit_changes_the_root_and_order_matters() {
        let mut changed = leaves(7);
        let before = root(&changed);
        changed[4][31] ^= 1;
        assert_ne!(root(&changed), before);
        changed[4][31] ^= 1;
        changed.swap(0, 1);
        assert_ne!(root(&changed), before);
    }
}
