//! The Lite draw: one task per family, drawn as Python's `random` draws it (`docs/rules.md#lite-draw`).
//!
//! CPython's `random.Random(seed)` is a Mersenne Twister keyed with the seed's 32-bit words. `choice` draws as many
//! bits as the length has, and draws again until the result is below the length. The generator comes from `rand_mt`.

use rand_mt::Mt;

use super::{Suite, Task};

/// Returns the indices that `random.Random(seed).choice` draws, one for each of `lengths`, in order.
#[must_use]
pub fn draw_indices(seed: u64, lengths: &[usize]) -> Vec<usize> {
    let (low, high) = (seed & 0xffff_ffff, seed >> 32);
    let words = [low as u32, high as u32];
    let mut twister = Mt::new_with_key(words[..if high == 0 { 1 } else { 2 }].iter().copied());
    lengths.iter().map(|&n| below(&mut twister, n)).collect()
}

/// Draws a number below `n`; returns 0 if `n` is 0.
fn below(twister: &mut Mt, n: usize) -> usize {
    if n == 0 {
        return 0;
    }
    let bits = (usize::BITS - n.leading_zeros()).min(32);
    loop {
        let drawn = (twister.next_u32() >> (32 - bits)) as usize;
        if drawn < n {
            return drawn;
        }
    }
}

/// Draws one task of each family of `suite` with this seed, in family order.
#[must_use]
pub fn draw(suite: &Suite, seed: u64) -> Vec<&Task> {
    let families = suite.families();
    let lengths: Vec<usize> = families.iter().map(|family| family.len()).collect();
    draw_indices(seed, &lengths).into_iter().zip(families).filter_map(|(i, family)| family.get(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From CPython 3.11: `r = random.Random(seed); [r.choice(range(n)) for n in lengths]`.
    #[test]
    fn draws_as_cpython_draws() {
        let lengths = [64, 48, 48, 96, 6, 6, 54, 1, 21];
        assert_eq!(draw_indices(42, &lengths), PYTHON_42);
        assert_eq!(draw_indices(0, &lengths), PYTHON_0);
        assert_eq!(draw_indices(1 << 40, &lengths), PYTHON_2_40);
    }

    const PYTHON_42: [usize; 9] = [14, 1, 47, 35, 1, 1, 8, 0, 17];
    const PYTHON_0: [usize; 9] = [49, 26, 2, 33, 4, 3, 25, 0, 15];
    const PYTHON_2_40: [usize; 9] = [13, 22, 42, 8, 3, 0, 24, 0, 20];
}
