//! The part of a log that a follower must remember: the roots of its complete subtrees, one for each 1 in the binary
//! form of its size.

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::hidden::canonical::{Hash, unhex};
use crate::hidden::merkle::node;
use crate::tasks::hex;

/// The right edge of a tree, from which it can grow.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frontier {
    size: u64,
    /// Roots of the complete subtrees, the largest first.
    roots: Vec<Hash>,
}

/// A frontier as it is stored.
#[derive(Debug, Serialize, Deserialize)]
struct Stored {
    size: u64,
    roots: Vec<String>,
}

impl Frontier {
    /// Returns the number of leaves.
    #[must_use]
    pub const fn size(&self) -> u64 {
        self.size
    }

    /// Appends a leaf.
    pub fn push(&mut self, leaf: Hash) {
        let mut hash = leaf;
        for _ in 0..self.size.trailing_ones() {
            let left = self.roots.pop().expect("there is a subtree for each digit of the size");
            hash = node(&left, &hash);
        }
        self.roots.push(hash);
        self.size += 1;
    }

    /// Returns the root of the tree.
    #[must_use]
    pub fn root(&self) -> Hash {
        let joined = self.roots.iter().copied().rev().reduce(|right, left| node(&left, &right));
        joined.unwrap_or_else(|| Sha256::digest([]).into())
    }
}

impl Serialize for Frontier {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Stored { size: self.size, roots: self.roots.iter().map(|root| hex(root)).collect() }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Frontier {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Stored { size, roots } = Stored::deserialize(deserializer)?;
        let roots: Option<Vec<Hash>> = roots.iter().map(|root| unhex(root)).collect();
        let roots = roots.filter(|roots| roots.len() == size.count_ones() as usize);
        roots.map(|roots| Self { size, roots }).ok_or_else(|| serde::de::Error::custom("not the frontier of a log"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::tlog::tree::{Tree, leaf};

    #[test]
    fn it_grows_as_the_tree_does() {
        let (mut tree, mut frontier) = (Tree::default(), Frontier::default());
        for i in 0..200_u32 {
            assert_eq!((Some(frontier.root()), frontier.size()), (tree.root(u64::from(i)), u64::from(i)));
            tree.push(leaf(&i.to_be_bytes()));
            frontier.push(leaf(&i.to_be_bytes()));
            // As it is after it was stored.
            frontier = serde_json::from_str(&serde_json::to_string(&frontier).unwrap()).unwrap();
        }
        for wrong in [r#"{"size": 3, "roots": []}"#, r#"{"size": 1, "roots": ["ab"]}"#] {
            assert!(serde_json::from_str::<Frontier>(wrong).is_err());
        }
    }
}
