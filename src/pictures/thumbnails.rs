//! The cache of thumbnails.

use bytes::Bytes;
use quick_cache::Weighter;
use quick_cache::sync::Cache;

/// Memory for thumbnails, in bytes, and the number of them that is expected.
const MEMORY: u64 = 32 << 20;
const EXPECTED: usize = 4_000;

/// Thumbnails by what they show.
pub type Thumbnails = Cache<String, Bytes, ByBytes>;

/// Weighs thumbnails by their size.
#[derive(Debug, Clone)]
pub struct ByBytes;

impl Weighter<String, Bytes> for ByBytes {
    fn weight(&self, key: &String, value: &Bytes) -> u64 {
        (key.len() + value.len()) as u64
    }
}

/// Creates an empty cache of thumbnails.
#[must_use]
pub fn thumbnails() -> Thumbnails {
    Cache::with_weighter(EXPECTED, MEMORY, ByBytes)
}
