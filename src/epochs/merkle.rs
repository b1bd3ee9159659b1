//! Merkle trees over hashes, as RFC 6962 builds them: leaves and nodes are hashed under different prefixes, and a tree of any
//! size splits at the greatest power of two below it.

use sha2::{Digest as _, Sha256};

use super::canonical::Hash;

/// Hash of a leaf: SHA-256 over 0, salt and content hash.
#[must_use]
pub fn leaf(salt: &Hash, content: &Hash) -> Hash {
    Sha256::new().chain_update([0]).chain_update(salt).chain_update(content).finalize().into()
}

fn node(left: &Hash, right: &Hash) -> Hash {
    Sha256::new().chain_update([1]).chain_update(left).chain_update(right).finalize().into()
}

const fn split(leaves: usize) -> usize {
    leaves.next_power_of_two() / 2
}

/// Root over leaves in order; of none SHA-256 over nothing.
#[must_use]
pub fn root(leaves: &[Hash]) -> Hash {
    match leaves {
        [] => Sha256::digest([]).into(),
        [only] => *only,
        _ => {
            let (left, right) = leaves.split_at(split(leaves.len()));
            node(&root(left), &root(right))
        }
    }
}

/// The siblings from a leaf up to the root: what proves to one who has the root alone that the leaf is in the tree. None where
/// there is no such leaf.
#[must_use]
pub fn proof(leaves: &[Hash], index: usize) -> Option<Vec<Hash>> {
    if index >= leaves.len() {
        return None;
    }
    if leaves.len() == 1 {
        return Some(Vec::new());
    }
    let at = split(leaves.len());
    let (left, right) = leaves.split_at(at);
    let (mut path, sibling) =
        if index < at { (proof(left, index)?, root(right)) } else { (proof(right, index - at)?, root(left)) };
    path.push(sibling);
    Some(path)
}

/// The root that a proof leads to from a leaf.
#[must_use]
pub fn climb(leaf: &Hash, index: usize, leaves: usize, path: &[Hash]) -> Option<Hash> {
    if leaves <= 1 {
        return (path.is_empty() && index == 0).then_some(*leaf);
    }
    let (sibling, below) = path.split_last()?;
    let at = split(leaves);
    if index < at {
        Some(node(&climb(leaf, index, at, below)?, sibling))
    } else {
        Some(node(sibling, &climb(leaf, index - at, leaves - at, below)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves(n: usize) -> Vec<Hash> {
        (0..n).map(|i| leaf(&[0; 32], &[i as u8; 32])).collect()
    }

    #[test]
    fn every_leaf_is_proved_in_trees_of_every_size() {
        for n in 1..40 {
            let leaves = leaves(n);
            for i in 0..n {
                let path = proof(&leaves, i).unwrap();
                assert_eq!(climb(&leaves[i], i, n, &path), Some(root(&leaves)), "leaf {i} of {n}");
                assert_ne!(climb(&[9; 32], i, n, &path), Some(root(&leaves)));
            }
        }
        assert!(proof(&leaves(3), 3).is_none());
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
