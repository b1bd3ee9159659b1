//! Operations on vectors of all unknowns.

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
