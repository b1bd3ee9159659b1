//! Compression of stored bodies: zstd, a frame for each.

use std::io;
use std::sync::{Mutex, PoisonError};

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::get_frame_content_size;

use super::{StoreError, StoreResult};

const LEVEL: i32 = 3;
/// Bytes of a body, uncompressed, up to which contexts are kept and used again: to make one takes longer than to
/// compress a usual log. Larger bodies grow their contexts to several MB.
const SMALL: usize = 256 << 10;
/// Maximum number of contexts of a kind that are kept: as many as work at the same time on most machines.
const KEPT: usize = 8;

static COMPRESSORS: Contexts<Compressor<'static>> = Contexts::new();
static DECOMPRESSORS: Contexts<Decompressor<'static>> = Contexts::new();

/// Compresses a body for storage.
///
/// # Errors
/// Returns an error if memory does not suffice.
pub(super) fn compress(bytes: &[u8]) -> StoreResult<Vec<u8>> {
    let packed = if bytes.len() <= SMALL {
        COMPRESSORS.with(|| Compressor::new(LEVEL), |compressor| compressor.compress(bytes))
    } else {
        zstd::bulk::compress(bytes, LEVEL)
    };
    packed.map_err(|error| StoreError::failed("compression", error))
}

/// Decompresses a body that `table` holds.
///
/// # Errors
/// Returns an error if the body is not what [`compress`] returned.
pub(super) fn decompress(table: &'static str, bytes: &[u8]) -> StoreResult<Vec<u8>> {
    let length = get_frame_content_size(bytes).ok().flatten().and_then(|length| usize::try_from(length).ok());
    let body = match length {
        Some(length) if length <= SMALL => {
            DECOMPRESSORS.with(Decompressor::new, |decompressor| decompressor.decompress(bytes, length))
        }
        // A damaged body may claim any length, so this reads no further than there are bytes.
        _ => zstd::stream::decode_all(bytes),
    };
    body.map_err(|error| StoreError::corrupt(table, error))
}

/// Contexts that nobody uses now.
struct Contexts<T>(Mutex<Vec<T>>);

impl<T> Contexts<T> {
    const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Works with a context that is kept, or else with a new one. Keeps it if the work succeeds.
    fn with<R>(
        &self,
        new: impl FnOnce() -> io::Result<T>,
        work: impl FnOnce(&mut T) -> io::Result<R>,
    ) -> io::Result<R> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = kept().pop();
        let mut context = match taken {
            Some(context) => context,
            None => new()?,
        };
        let done = work(&mut context)?;
        let mut kept = kept();
        if kept.len() < KEPT {
            kept.push(context);
        }
        Ok(done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_of_every_length_come_back_and_contexts_leave_no_trace() {
        let mut text = Vec::new();
        for length in [0, 1, 100, 10_000, SMALL, SMALL + 1, 3 * SMALL, 5, 0] {
            text.extend((text.len()..length).map(|i| (i * i / 7) as u8));
            let body = &text[..length];
            let packed = compress(body).unwrap();
            assert_eq!(packed, zstd::bulk::compress(body, LEVEL).unwrap(), "{length}");
            assert_eq!(decompress("reports", &packed).unwrap(), body, "{length}");
        }
    }

    #[test]
    fn damaged_bodies_are_errors_and_spoil_none_that_follow() {
        let body = [b"block ".repeat(300), (0..=255).collect()].concat();
        let packed = compress(&body).unwrap();
        for cut in 0..packed.len() {
            assert!(decompress("reports", &packed[..cut]).is_err() || cut == 0, "cut at {cut}");
        }
        for place in 0..packed.len() {
            let mut damaged = packed.clone();
            damaged[place] ^= 0x55;
            // Without a checksum some damage shows only in the body.
            let _ = decompress("reports", &damaged);
            assert_eq!(decompress("reports", &packed).unwrap(), body);
        }
    }
}
