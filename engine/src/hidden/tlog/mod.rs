//! The transparency log of receipts in the field's formats: a Merkle tree (RFC 6962), served as tiles (C2SP tlog-tiles)
//! with checkpoints as signed notes (C2SP tlog-checkpoint, signed-note).
//!
//! An entry of the log is the SHA-256 of a receipt, in the order of the receipts. So the log begins with the first
//! receipt that the service ever signed, and a receipt that is withheld until its epoch closes is in it by its hash
//! alone.

pub mod cosignature;
pub mod frontier;
pub mod note;
pub mod proof;
pub mod tiles;
pub mod tree;
