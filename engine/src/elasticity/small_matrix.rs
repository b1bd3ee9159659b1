//! Inverses of 3 x 3 matrices: the ordinary inverse, and the pseudo-inverse of singular matrices.

use nalgebra::{Matrix3, Vector3};

/// Fraction of the largest singular value up to which a singular value counts as zero
/// (`docs/rules.md#the-published-simulation`).
const RELATIVE_CUTOFF: f64 = 1e-12;

/// Returns the inverse, or the pseudo-inverse if elimination meets a pivot that is exactly zero.
#[must_use]
pub fn inverse_or_pseudo_inverse(m: &Matrix3<f64>) -> Matrix3<f64> {
    inverse(m).unwrap_or_else(|| pseudo_inverse(m))
}

/// Flatness of a neighbourhood, as its moment matrix shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flatness {
    /// The neighbourhood extends in three directions.
    Full,
    /// The neighbourhood lies in a plane or line along the axes: missing directions are exactly zero.
    AlongAxes,
    /// The neighbourhood lies in a sloped plane or line: missing directions are zero except for rounding errors, which
    /// then decide the result.
    Sloped,
}

/// Fraction of the largest singular value up to which a singular value is zero except for rounding errors.
const ROUNDING_CUTOFF: f64 = 1e-9;

/// Returns the flatness of the neighbourhood with this moment matrix.
#[must_use]
pub fn flatness(moment: &Matrix3<f64>) -> Flatness {
    // The least singular value is at least |det| divided by the square of the norm.
    if moment.determinant().abs() > ROUNDING_CUTOFF * moment.norm().powi(3) {
        return Flatness::Full;
    }
    let singular = moment.singular_values();
    let missing = singular.iter().filter(|value| **value <= ROUNDING_CUTOFF * singular.max()).count();
    let zero_columns = (0..3).filter(|&k| moment.column(k).iter().all(|entry| *entry == 0.0)).count();
    match missing {
        0 => Flatness::Full,
        _ if missing == zero_columns => Flatness::AlongAxes,
        _ => Flatness::Sloped,
    }
}

/// Computes the inverse by Gauss-Jordan elimination with row pivoting; `None` if a pivot is exactly zero.
fn inverse(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let mut a = *m;
    let mut b = Matrix3::identity();
    for column in 0..3 {
        let mut pivot = column;
        for row in column + 1..3 {
            if a[(row, column)].abs() > a[(pivot, column)].abs() {
                pivot = row;
            }
        }
        if a[(pivot, column)] == 0.0 {
            return None;
        }
        a.swap_rows(column, pivot);
        b.swap_rows(column, pivot);
        let scale = 1.0 / a[(column, column)];
        for k in 0..3 {
            a[(column, k)] *= scale;
            b[(column, k)] *= scale;
        }
        for row in 0..3 {
            let factor = a[(row, column)];
            if row != column && factor != 0.0 {
                for k in 0..3 {
                    a[(row, k)] -= factor * a[(column, k)];
                    b[(row, k)] -= factor * b[(column, k)];
                }
            }
        }
    }
    Some(b)
}

/// Computes the Moore-Penrose pseudo-inverse by one-sided Jacobi rotations. Zero columns stay exactly zero, so a flat
/// part in an axis plane stays exactly flat.
#[must_use]
pub fn pseudo_inverse(m: &Matrix3<f64>) -> Matrix3<f64> {
    let mut u = *m;
    let mut v = Matrix3::<f64>::identity();
    for _sweep in 0..60 {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let alpha = u.column(p).norm_squared();
            let beta = u.column(q).norm_squared();
            let gamma = u.column(p).dot(&u.column(q));
            if gamma == 0.0 || gamma.abs() <= f64::EPSILON * (alpha * beta).sqrt() {
                continue;
            }
            rotated = true;
            let zeta = (beta - alpha) / (2.0 * gamma);
            let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
            let s = c * t;
            for matrix in [&mut u, &mut v] {
                let (a, b): (Vector3<f64>, Vector3<f64>) = (matrix.column(p).into(), matrix.column(q).into());
                matrix.set_column(p, &(a * c - b * s));
                matrix.set_column(q, &(a * s + b * c));
            }
        }
        if !rotated {
            break;
        }
    }
    let singular: [f64; 3] = std::array::from_fn(|k| u.column(k).norm());
    let largest = singular.iter().copied().fold(0.0, f64::max);
    let mut result = Matrix3::zeros();
    for (k, &value) in singular.iter().enumerate() {
        if value > RELATIVE_CUTOFF * largest && value > 0.0 {
            result += v.column(k) * u.column(k).transpose() / (value * value);
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_close(a: &Matrix3<f64>, b: &Matrix3<f64>, tolerance: f64) -> bool {
        (a - b).abs().max() <= tolerance
    }

    proptest! {
        #[test]
        fn the_pseudo_inverse_satisfies_penrose(entries in prop::array::uniform9(-3..4i32)) {
            let m = Matrix3::from_iterator(entries.iter().map(|&e| f64::from(e)));
            let p = pseudo_inverse(&m);
            prop_assert!(is_close(&(m * p * m), &m, 1e-9));
            prop_assert!(is_close(&(p * m * p), &p, 1e-9));
            prop_assert!(is_close(&(m * p).transpose(), &(m * p), 1e-9));
            prop_assert!(is_close(&(p * m).transpose(), &(p * m), 1e-9));
        }
    }

    #[test]
    fn a_flat_matrix_stays_exactly_flat() {
        let m = Matrix3::new(2.0, 0.5, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0);
        assert_eq!(flatness(&m), Flatness::AlongAxes);
        let p = inverse_or_pseudo_inverse(&m);
        assert!((0..3).all(|k| p[(2, k)] == 0.0 && p[(k, 2)] == 0.0));
        assert!(is_close(&(m * p * m), &m, 1e-14));
    }
}
