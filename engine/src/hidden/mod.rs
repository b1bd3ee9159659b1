//! Hidden evaluation in epochs: an epoch commits to its specifications before it opens, draws instances that neither
//! side can choose, and reveals everything after it closes.
//!
//! The pool and the draws derive all their randomness from the epoch's secret key. The generator in `pool` makes
//! specifications from it, each certified solvable by its reference builder. `commitment` publishes a hash of the key
//! and the root of a Merkle tree over the salted hashes of the pool. `issue` selects the specification that an entry
//! receives, from key, entry, the entrant's nonce, family, run and index; `draw_proof` proves it at once. `evidence`
//! records each step in a receipt that is signed immediately, and `receipts` signs the grades. `reveal` publishes
//! everything afterwards, and `verify` checks it.
//!
//! This module is pure: callers pass in keys and times, and it never creates them.

pub mod announcements;
pub mod beacon;
pub mod board;
pub mod canonical;
pub mod commitment;
pub mod draw_proof;
pub mod evidence;
pub mod feedback;
pub mod gauge;
mod generators;
pub mod issue;
pub mod ladder;
pub mod merkle;
pub mod pool;
pub mod receipts;
pub mod reveal;
pub mod secret;
pub mod siblings;
pub mod tlog;
pub mod verify;

/// Latest version of the generator: its families, ranges, strata and draw procedure. Version 3 has the families of
/// version 2, and draws no build that is on the public list of siblings. Version 4 draws from version 3
/// of the hidden suite, and has a list of siblings of its own. Add a version with any change that makes the
/// same key draw different specifications; earlier versions stay, because their epochs are verified with them.
pub const GENERATOR_VERSION: u32 = 4;

/// Latest version of the protocol of an epoch, which its rules name. Since version 2 a third of the instances of a dev
/// entry is kept for the final board, and the public log grows by what is public anyway. Since version 3 the receipt of a
/// draw states what was asked.
pub const PROTOCOL: u32 = 3;

/// First version of the protocol in which a part of the dev tier is kept for the final board.
pub const FIRST_WITH_KEPT_PART: u32 = 2;

/// First version of the protocol in which the receipt of a draw states what was asked.
pub const FIRST_WITH_PROMPTS: u32 = 3;
