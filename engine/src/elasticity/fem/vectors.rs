//! Operations on vectors of all unknowns.

use std::ops::Range;

use crate::elasticity::Control;

/// Least length of vectors whose halves are worth two cores.
const LEAST_LENGTH: usize = 200_000;
/// Entries that are processed at a time: those of several vectors fit into the first cache.
const STRIP: usize = 512;

/// Adds `factor` times a vector to another.
pub fn add(factor: f64, vector: &[f64], to: &mut [f64]) {
    for (to, entry) in to.iter_mut().zip(vector) {
        *to += factor * entry;
    }
}

/// Computes what `apply` leaves of `force`.
pub fn subtract(force: &[f64], apply: impl FnOnce(&mut [f64]), rest: &mut [f64]) {
    apply(rest);
    for (rest, force) in rest.iter_mut().zip(force) {
        *rest = force - *rest;
    }
}

/// Returns the inner product, in eight partial sums so that additions do not wait for each other.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Does `operation` on one strip of vectors of equal length after the other, reading `read` and changing `written`, and
/// returns the sums of what it returns. Two cores share long vectors if `control` lends them; the sums do not depend on
/// that.
pub fn in_strips<const R: usize, const W: usize, const K: usize>(
    control: &Control<'_>,
    read: [&[f64]; R],
    mut written: [&mut [f64]; W],
    operation: impl Fn([&[f64]; R], [&mut [f64]; W]) -> [f64; K] + Sync,
) -> [f64; K] {
    let len = read.first().map_or(0, |vector| vector.len());
    let strips = |read: [&[f64]; R], mut written: [&mut [f64]; W]| {
        let len = read.first().map_or(0, |vector| vector.len());
        let mut sums = [0.0; K];
        for first in (0..len).step_by(STRIP) {
            let strip = first..len.min(first + STRIP);
            let parts = operation(read.map(|vector| &vector[strip.clone()]), parts(&mut written, strip));
            sums = std::array::from_fn(|k| sums[k] + parts[k]);
        }
        sums
    };
    if len < LEAST_LENGTH {
        return strips(read, written);
    }
    let at = len / 2 / STRIP * STRIP;
    let (first, second) = (read.map(|vector| &vector[..at]), read.map(|vector| &vector[at..]));
    let written_first = front(&mut written, at);
    let (mut sums, mut others) = ([0.0; K], [0.0; K]);
    control.both(|| sums = strips(first, written_first), || others = strips(second, written));
    std::array::from_fn(|k| sums[k] + others[k])
}

/// Takes the first entries off vectors.
pub fn front<'a, const W: usize>(vectors: &mut [&'a mut [f64]; W], len: usize) -> [&'a mut [f64]; W] {
    vectors.each_mut().map(|vector| vector.split_off_mut(..len).expect("the vectors are as long as their parts"))
}

/// Returns the same part of several vectors.
#[inline]
pub fn parts<'a, const W: usize>(vectors: &'a mut [&mut [f64]; W], part: Range<usize>) -> [&'a mut [f64]; W] {
    vectors.each_mut().map(|vector| &mut vector[part.clone()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elasticity::tests::on_two_threads;

    #[test]
    fn strips_cover_all_entries_once_on_one_core_and_on_two() {
        let on_two = Control { join: Some(&on_two_threads), ..Control::unhurried() };
        for len in [0, 1, STRIP, 3 * STRIP + 5, LEAST_LENGTH, LEAST_LENGTH + 3] {
            let read: Vec<f64> = (0..len).map(|i| (i % 7) as f64).collect();
            for control in [&Control::unhurried(), &on_two] {
                let mut written = vec![1.0; len];
                let [sum] = in_strips(control, [&read], [&mut written], |[read], [written]| {
                    add(2.0, read, written);
                    [dot(read, read)]
                });
                assert_eq!(sum, read.iter().map(|entry| entry * entry).sum::<f64>(), "{len}");
                assert!(written.iter().zip(&read).all(|(written, read)| *written == 1.0 + 2.0 * read), "{len}");
            }
        }
    }
}
