//! Names of tiles, checkpoints, keys, proofs and receipts, as verifiers get them from strangers.

use plumbline_engine::hidden::receipts::{ReceiptFile, verify};
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::hidden::tlog::note::{Checkpoint, read_verifier_key};
use plumbline_engine::hidden::tlog::proof::{is_consistent, is_included};
use plumbline_engine::hidden::tlog::tiles::{TileName, read_entries};
use plumbline_engine::hidden::tlog::tree::{Tree, leaf};

/// Greatest number of leaves of a tree.
const MAX: u64 = 64;

pub fn run(data: &[u8]) {
    let _ = read_entries(data, data.len() / 34);
    tree(data);
    if let Ok(file) = serde_json::from_slice::<ReceiptFile>(data) {
        let _ = verify(&file, &[]);
        let _ = file.verify_inclusion(&[]);
    }
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Some(tile) = TileName::parse(text) {
        assert_eq!(tile.to_string(), text);
        assert!(tile.hashes(&Tree::default()).is_none());
    }
    let _ = read_verifier_key(text);
    let _ = Witness::read(text);
    if let Some((said, signatures)) = Checkpoint::parts(text) {
        assert!(text.starts_with(&said), "{} signatures", signatures.len());
    }
    assert!(Checkpoint::verified(text, &[]).is_none());
}

/// The proofs of a tree hold, and no other hash does.
fn tree(data: &[u8]) {
    let [size, index, old, rest @ ..] = data else { return };
    let (size, mut tree) = (u64::from(*size) % MAX + 1, Tree::default());
    (0..size).for_each(|i| tree.push(leaf(&i.to_be_bytes())));
    let (index, old) = (u64::from(*index) % size, u64::from(*old) % size + 1);
    let (root, old_root) = (tree.root(size).expect("it has a root"), tree.root(old).expect("it has had a root"));
    let own = leaf(&index.to_be_bytes());
    let mut proof = tree.inclusion(index, size).expect("the leaf is there");
    assert!(is_included(&own, index, size, &proof, &root));
    let kept = tree.consistency(old, size).expect("the tree grew");
    assert!(is_consistent(old, size, &old_root, &root, &kept));
    if let ([at, bit, ..], true) = (rest, !proof.is_empty()) {
        let at = usize::from(*at) % proof.len();
        proof[at][usize::from(*bit) / 8] ^= 1 << (bit % 8);
        assert!(!is_included(&own, index, size, &proof, &root));
    }
}
