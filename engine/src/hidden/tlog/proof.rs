//! Checking proofs of a tree without the tree (RFC 9162, sections 2.1.3.2 and 2.1.4.2).

use crate::hidden::canonical::Hash;
use crate::hidden::merkle::node;

/// Returns whether a proof shows that a leaf is at a position in the tree of `size` leaves with this root.
#[must_use]
pub fn is_included(leaf: &Hash, index: u64, size: u64, proof: &[Hash], root: &Hash) -> bool {
    if index >= size {
        return false;
    }
    let (mut own, mut last, mut hash) = (index, size - 1, *leaf);
    for sibling in proof {
        if last == 0 {
            return false;
        }
        if own % 2 == 1 || own == last {
            hash = node(sibling, &hash);
            while own % 2 == 0 && own != 0 {
                (own, last) = (own >> 1, last >> 1);
            }
        } else {
            hash = node(&hash, sibling);
        }
        (own, last) = (own >> 1, last >> 1);
    }
    last == 0 && hash == *root
}

/// Returns whether a proof shows that the tree of `size` leaves with root `new_root` begins with the tree of the first
/// `old` leaves with root `old_root`. The service needs no such proofs, because witnesses read tiles; programs that use
/// the engine as a library may.
#[must_use]
pub fn is_consistent(old: u64, size: u64, old_root: &Hash, new_root: &Hash, proof: &[Hash]) -> bool {
    if old == 0 || old >= size {
        // Every tree begins with the empty one, and with itself.
        return proof.is_empty() && (old == 0 || (old == size && old_root == new_root));
    }
    let (first, rest) = match (old.is_power_of_two(), proof) {
        (true, all) => (old_root, all),
        (false, [first, rest @ ..]) => (first, rest),
        (false, []) => return false,
    };
    let (mut own, mut last) = (old - 1, size - 1);
    while own % 2 == 1 {
        (own, last) = (own >> 1, last >> 1);
    }
    let (mut from_old, mut from_new) = (*first, *first);
    for sibling in rest {
        if last == 0 {
            return false;
        }
        if own % 2 == 1 || own == last {
            from_old = node(sibling, &from_old);
            from_new = node(sibling, &from_new);
            while own % 2 == 0 && own != 0 {
                (own, last) = (own >> 1, last >> 1);
            }
        } else {
            from_new = node(&from_new, sibling);
        }
        (own, last) = (own >> 1, last >> 1);
    }
    last == 0 && from_old == *old_root && from_new == *new_root
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::tlog::tree::{Tree, leaf};

    fn tree(leaves: u32) -> Tree {
        let mut tree = Tree::default();
        (0..leaves).for_each(|i| tree.push(leaf(&i.to_be_bytes())));
        tree
    }

    #[test]
    fn every_leaf_of_every_size_is_proven_and_no_other() {
        let tree = tree(40);
        for size in 1..=40 {
            let root = tree.root(size).unwrap();
            for index in 0..size {
                let own = leaf(&(index as u32).to_be_bytes());
                let proof = tree.inclusion(index, size).unwrap();
                assert!(is_included(&own, index, size, &proof, &root), "{index} of {size}");
                assert!(!is_included(&leaf(b"another"), index, size, &proof, &root));
                assert!(index == 0 || !is_included(&own, index - 1, size, &proof, &root), "{index} of {size}");
                let longer = [&proof[..], &[root]].concat();
                assert!(!is_included(&own, index, size, &longer, &root));
                assert!(proof.is_empty() || !is_included(&own, index, size, &proof[1..], &root));
            }
            assert_eq!(tree.inclusion(size, size), None);
        }
    }

    #[test]
    fn every_tree_is_proven_to_begin_with_every_earlier_one() {
        let (tree, other) = (tree(40), {
            let mut other = Tree::default();
            (0..40_u32).for_each(|i| other.push(leaf(&(i + u32::from(i == 3)).to_be_bytes())));
            other
        });
        for size in 0..=40 {
            for old in 0..=size {
                let (old_root, new_root) = (tree.root(old).unwrap(), tree.root(size).unwrap());
                let proof = tree.consistency(old, size).unwrap();
                assert!(is_consistent(old, size, &old_root, &new_root, &proof), "{old} of {size}");
                if old > 3 {
                    let forged = other.root(size).unwrap();
                    assert!(!is_consistent(old, size, &old_root, &forged, &proof), "{old} of {size}");
                    let theirs = other.consistency(old, size).unwrap();
                    assert!(!is_consistent(old, size, &old_root, &forged, &theirs), "{old} of {size}");
                }
            }
        }
        assert_eq!(tree.consistency(5, 41), None);
    }
}
