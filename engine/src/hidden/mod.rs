//! Hidden evaluation: epochs that commit to their specifications before they open, draw instances that neither side can
//! choose, and reveal everything after they close.
//!
//! An epoch's secret key is all that is random. From it the generator makes a pool of specifications, each one certified
//! solvable by its reference builder; `commitment` publishes a hash of the key and the root of a Merkle tree over the salted
//! hashes of the pool; `issue` tells which specification of the pool an entry gets, from key, entry, the entry's own nonce,
//! family and index; `evidence` states what happened, in receipts that are signed at once; `reveal` and `verify` check all of it
//! afterwards. `receipts` signs what grading found.
//!
//! This room is pure: it gets keys and times from outside and never makes them.

pub mod board;
pub mod canonical;
pub mod commitment;
pub mod evidence;
pub mod feedback;
pub mod issue;
pub mod ladder;
pub mod merkle;
pub mod pool;
pub mod receipts;
pub mod reveal;
pub mod secret;
pub mod verify;

/// Version of the generator: families, ranges, strata and how they are drawn. A change that draws other specifications from
/// the same key raises it.
pub const GENERATOR_VERSION: u32 = 1;
