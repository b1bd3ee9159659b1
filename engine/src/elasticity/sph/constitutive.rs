//! Stress from deformation, for as many particles at a time as a SIMD vector holds
//! (`docs/rules.md#the-published-simulation`).

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::Matrix3;
use pulp::Simd;

use super::stencil::{Matrices, Place};
use crate::elasticity::{POISSON, YOUNG_PA};

/// First Lame parameter in the published (not the usual three-dimensional) form, Pa.
const LAMBDA_PA: f64 = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - POISSON));
/// Second Lame parameter, Pa.
const MU_PA: f64 = YOUNG_PA / (2.0 * (1.0 + POISSON));
/// Viscosity, Pa s.
const VISCOSITY: f64 = 1e7;

/// Computes the first Piola-Kirchhoff stress, Pa, from the deformation gradient `f` and its value `before` a step of
/// `step_s` seconds.
///
/// `P = F S + 2 eta d' C` with `C = J F^-T` the cofactors of F, and `L = Fdot C^T / J`. If J is exactly zero, the
/// viscous part vanishes, as it does with a pseudo-inverse.
#[inline(always)]
pub fn stress<S: Simd>(place: &Place<'_, S>, f: &Matrices<S>, before: &Matrices<S>, step_s: f64) -> Matrices<S> {
    let [elastic, cofactor] = [second_piola_kirchhoff(place, f), cofactors(f)];
    let drag = viscous_deviator(place, f, before, &cofactor, step_s);
    let mut p = *f;
    for i in 0..3 {
        for j in 0..3 {
            let slow =
                drag[i][0].mul_add(cofactor[0][j], drag[i][1].mul_add(cofactor[1][j], drag[i][2] * cofactor[2][j]));
            p[i][j] =
                f[i][0].mul_add(elastic[0][j], f[i][1].mul_add(elastic[1][j], f[i][2].mul_add(elastic[2][j], slow)));
        }
    }
    p
}

/// Computes `S = lambda tr(E) I + 2 mu E` with `E = (F^T F - I) / 2`.
#[inline(always)]
fn second_piola_kirchhoff<S: Simd>(place: &Place<'_, S>, f: &Matrices<S>) -> Matrices<S> {
    let (one, mu) = (place.splat(1.0), place.splat(MU_PA));
    let mut s = *f;
    for i in 0..3 {
        for j in 0..=i {
            s[i][j] = f[0][i].mul_add(f[0][j], f[1][i].mul_add(f[1][j], f[2][i] * f[2][j]));
        }
        s[i][i] = s[i][i] - one;
    }
    let pressure = (s[0][0] + s[1][1] + s[2][2]) * place.splat(0.5 * LAMBDA_PA);
    for i in 0..3 {
        s[i][i] = s[i][i].mul_add(mu, pressure);
        for j in 0..i {
            s[i][j] = s[i][j] * mu;
            s[j][i] = s[i][j];
        }
    }
    s
}

/// Computes the cofactors `J F^-T`.
#[inline(always)]
fn cofactors<S: Simd>(f: &Matrices<S>) -> Matrices<S> {
    let mut cofactor = *f;
    for i in 0..3 {
        let (i1, i2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (j1, j2) = ((j + 1) % 3, (j + 2) % 3);
            cofactor[i][j] = f[i1][j2].subtract_product_from(f[i2][j1], f[i1][j1] * f[i2][j2]);
        }
    }
    cofactor
}

/// Computes `2 eta d'` with `d'` the deviator of `sym L` and `L = (F - F_before) C^T / (J dt)`.
#[inline(always)]
fn viscous_deviator<S: Simd>(
    place: &Place<'_, S>,
    f: &Matrices<S>,
    before: &Matrices<S>,
    cofactor: &Matrices<S>,
    step_s: f64,
) -> Matrices<S> {
    let jacobian = f[0][0].mul_add(cofactor[0][0], f[0][1].mul_add(cofactor[0][1], f[0][2] * cofactor[0][2]));
    let eta_per_volume = (jacobian * place.splat(step_s / VISCOSITY)).reciprocal().unless_zero(jacobian);
    let mut rate = *f;
    for i in 0..3 {
        for j in 0..3 {
            rate[i][j] = f[i][j] - before[i][j];
        }
    }
    let mut l = *f;
    for i in 0..3 {
        for j in 0..3 {
            l[i][j] =
                rate[i][0].mul_add(cofactor[j][0], rate[i][1].mul_add(cofactor[j][1], rate[i][2] * cofactor[j][2]));
        }
    }
    let mean = (l[0][0] + l[1][1] + l[2][2]) * place.splat(1.0 / 3.0);
    let twice = eta_per_volume + eta_per_volume;
    let mut d = *f;
    for i in 0..3 {
        d[i][i] = (l[i][i] - mean) * twice;
        for j in 0..i {
            d[i][j] = (l[i][j] + l[j][i]) * eta_per_volume;
            d[j][i] = d[i][j];
        }
    }
    d
}

/// Computes the same as [`stress`] for one particle.
#[must_use]
pub fn stress_of_one(f: &Matrix3<f64>, before: &Matrix3<f64>, step_s: f64) -> Matrix3<f64> {
    let strain = (f.transpose() * f - Matrix3::identity()) * 0.5;
    let elastic = f * (Matrix3::identity() * (LAMBDA_PA * strain.trace()) + strain * (2.0 * MU_PA));
    let cofactor = Matrix3::from_fn(|i, j| {
        let ([i1, i2], [j1, j2]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        f[(i1, j1)] * f[(i2, j2)] - f[(i1, j2)] * f[(i2, j1)]
    });
    let jacobian = f.determinant();
    if jacobian == 0.0 {
        return elastic;
    }
    let l = (f - before) * cofactor.transpose() / (jacobian * step_s);
    let d = (l + l.transpose()) * 0.5;
    elastic + (d - Matrix3::identity() * (d.trace() / 3.0)) * cofactor * (2.0 * VISCOSITY)
}
