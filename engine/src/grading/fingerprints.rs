//! Fingerprints of logs, which find near-identical logs of different owners without comparing the logs themselves.
//!
//! A fingerprint has two sketches: one of the set of blocks, and one of the pairs of cells filled one after the other.
//! Cells are relative to the least corner of the build, so moving a build changes nothing. A sketch keeps the least
//! hash in each of 64 bins (MinHash with one permutation: Li, Owen and Zhang, 2012); the share of bins that agree
//! estimates the share of elements in common (Jaccard). Sketches of parts merge into that of the whole.

use crate::voxel::{BlockLog, Bounds, Cell, Event};

const BINS: usize = 64;
/// Value of an empty bin.
const EMPTY: u32 = u32::MAX;
/// Least share in common, of both blocks and pairs, at which two runs are near-identical. Builds of one task are alike
/// whoever makes them, but the order in which independent builders place a thousand blocks is not.
const NEAR: f64 = 0.9;

/// Sketches of one log, or of all logs of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fingerprint {
    blocks: [u32; BINS],
    order: [u32; BINS],
}

impl Default for Fingerprint {
    fn default() -> Self {
        Self { blocks: [EMPTY; BINS], order: [EMPTY; BINS] }
    }
}

/// Mixes the bits of a number (the finalizer of `SplitMix64`).
const fn mixed(number: u64) -> u64 {
    let number = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let number = (number ^ (number >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    number ^ (number >> 31)
}

/// Hashes text, with the same result everywhere (FNV-1a).
fn hashed(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn add(sketch: &mut [u32; BINS], element: u64) {
    let hash = mixed(element);
    let bin = &mut sketch[(hash >> 58) as usize];
    *bin = (*bin).min(hash as u32);
}

impl Fingerprint {
    /// Computes the fingerprint of a log that answers a task.
    #[must_use]
    pub fn of(task_hash: &str, log: &BlockLog) -> Self {
        let mut own = Self::default();
        let placed = || {
            log.turns.iter().flatten().filter_map(|event| match *event {
                Event::Place { cell, material } => Some((cell, material)),
                Event::Remove { .. } => None,
            })
        };
        let Some(Bounds { min, .. }) = Bounds::of(placed().map(|(cell, _)| cell)) else { return own };
        let task = hashed(task_hash);
        let names: Vec<u64> = log.palette.names().map(hashed).collect();
        let at = |cell: Cell| {
            let [x, y, z] = [cell.x - min.x, cell.y - min.y, cell.z - min.z].map(|axis| u64::from(axis.unsigned_abs()));
            mixed(task ^ mixed(x ^ mixed(y ^ mixed(z))))
        };
        let mut last = None;
        for (cell, material) in placed() {
            let place = at(cell);
            add(&mut own.blocks, place ^ names.get(material as usize).copied().unwrap_or_default());
            if let Some(last) = last {
                add(&mut own.order, mixed(last) ^ place);
            }
            last = Some(place);
        }
        own
    }

    /// Merges another fingerprint into this one, which then covers the logs of both.
    pub fn merge(&mut self, other: &Self) {
        for (own, other) in [(&mut self.blocks, &other.blocks), (&mut self.order, &other.order)] {
            own.iter_mut().zip(other).for_each(|(own, other)| *own = (*own).min(*other));
        }
    }

    /// Returns whether two are of nearly the same blocks in nearly the same order; false if nothing was placed.
    #[must_use]
    pub fn is_near(&self, other: &Self) -> bool {
        // Between independent builders the order is the first to differ.
        in_common(&self.order, &other.order) >= NEAR && in_common(&self.blocks, &other.blocks) >= NEAR
    }

    /// Encodes the fingerprint for storage.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.blocks.iter().chain(&self.order).flat_map(|bin| bin.to_le_bytes()).collect()
    }

    /// Decodes a stored fingerprint. Returns `None` if the bytes are not one.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (bins, rest) = bytes.as_chunks::<4>();
        if bins.len() != 2 * BINS || !rest.is_empty() {
            return None;
        }
        let mut own = Self::default();
        for (bin, bytes) in own.blocks.iter_mut().chain(&mut own.order).zip(bins) {
            *bin = u32::from_le_bytes(*bytes);
        }
        Some(own)
    }
}

/// Returns the share of the bins in use that agree; 0 if none is in use.
fn in_common(one: &[u32; BINS], other: &[u32; BINS]) -> f64 {
    let used = one.iter().zip(other).filter(|(a, b)| **a != EMPTY || **b != EMPTY);
    let (agreeing, all) = used.fold((0, 0), |(agreeing, all), (a, b)| (agreeing + u32::from(a == b), all + 1));
    if all == 0 { 0.0 } else { f64::from(agreeing) / f64::from(all) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Builds a slab row by row, moved by `dx`, with its first `late` blocks placed last.
    fn slab(side: i32, late: usize, dx: i32) -> BlockLog {
        let mut cells: Vec<Cell> = (0..side).flat_map(|x| (0..side).map(move |z| Cell::new(x + dx, 0, z))).collect();
        cells.rotate_left(late);
        let mut log = BlockLog::default();
        log.turns.push(Vec::new());
        for cell in cells {
            log.place(cell, "stone");
        }
        log
    }

    #[test]
    fn copies_are_near_and_independent_builds_are_not() {
        let own = |log: &BlockLog| Fingerprint::of("task", log);
        let original = own(&slab(30, 0, 0));
        assert!(original.is_near(&own(&slab(30, 0, 500))), "moved");
        assert!(original.is_near(&own(&slab(30, 7, 0))), "begun elsewhere");
        let mut reversed = slab(30, 0, 0);
        reversed.turns[0].reverse();
        assert!(!original.is_near(&own(&reversed)), "the same blocks in another order");
        assert!(!original.is_near(&own(&slab(20, 0, 0))));
        assert!(!original.is_near(&Fingerprint::of("another task", &slab(30, 0, 0))));
        assert!(!Fingerprint::default().is_near(&Fingerprint::default()));
    }

    #[test]
    fn parts_merge_and_bytes_read_back() {
        let mut merged = Fingerprint::of("a", &slab(9, 0, 0));
        merged.merge(&Fingerprint::of("b", &slab(12, 0, 0)));
        let mut other = Fingerprint::of("b", &slab(12, 0, 0));
        other.merge(&Fingerprint::of("a", &slab(9, 0, 0)));
        assert_eq!(merged, other);
        assert_eq!(Fingerprint::from_bytes(&merged.to_bytes()), Some(merged));
        assert!(Fingerprint::from_bytes(&[0; 9]).is_none());
    }
}
