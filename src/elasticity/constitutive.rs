//! Stress from deformation, for eight particles at a time (SPEC 4).
//!
//! Each lane does what one particle needs; there are no branches, so the loop over lanes becomes vector instructions.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::Matrix3;

use super::pairs::Columns;

/// Particles treated at a time.
pub const LANES: usize = 8;

/// Young's modulus, Pa.
const YOUNG_PA: f64 = 1e9;
/// Poisson's ratio.
const POISSON: f64 = 0.4;
/// First Lame parameter in the published (not the usual three-dimensional) form, Pa.
const LAMBDA_PA: f64 = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - POISSON));
/// Second Lame parameter, Pa.
const MU_PA: f64 = YOUNG_PA / (2.0 * (1.0 + POISSON));
/// Viscosity, Pa s.
const VISCOSITY: f64 = 1e7;

/// One number for each lane.
type Lanes = [f64; LANES];
/// A 3 x 3 matrix for each lane, row by row.
type Matrices = [[Lanes; 3]; 3];

/// Eight particles.
#[derive(Debug, Clone)]
struct Batch {
    /// Deformation gradient after the step before.
    previous: Matrices,
    /// `A^-1`.
    moment_inverse: Matrices,
    /// First Piola-Kirchhoff stress P.
    stress: Matrices,
}

/// What the particles remember of their material's state.
#[derive(Debug)]
pub struct Materials {
    batches: Vec<Batch>,
}

impl Materials {
    /// Undeformed particles with these inverse moment matrices.
    #[must_use]
    pub fn new(moment_inverse: &[Matrix3<f64>]) -> Self {
        let batch = |inverses: &[Matrix3<f64>]| {
            let entry = |m: &dyn Fn(usize) -> f64| -> Lanes { std::array::from_fn(m) };
            let matrices = |m: &dyn Fn(usize, usize, usize) -> f64| -> Matrices {
                std::array::from_fn(|i| std::array::from_fn(|j| entry(&|lane| m(i, j, lane))))
            };
            Batch {
                previous: matrices(&|i, j, _| if i == j { 1.0 } else { 0.0 }),
                moment_inverse: matrices(&|i, j, lane| inverses.get(lane).map_or(0.0, |m| m[(i, j)])),
                stress: matrices(&|_, _, _| 0.0),
            }
        };
        Self { batches: moment_inverse.chunks(LANES).map(batch).collect() }
    }

    /// Takes the deformation gradients after a step of `step_s` seconds and gives `P A^-1`.
    #[inline(always)]
    pub fn update(&mut self, deformation: &[Columns], corrected_stress: &mut [Columns], step_s: f64) {
        let chunks = deformation.chunks(LANES).zip(corrected_stress.chunks_mut(LANES));
        for (batch, (deformation, corrected)) in self.batches.iter_mut().zip(chunks) {
            let mut f: Matrices = [[[0.0; LANES]; 3]; 3];
            for (lane, columns) in deformation.iter().enumerate() {
                for i in 0..3 {
                    for j in 0..3 {
                        f[i][j][lane] = columns[j][i];
                    }
                }
            }
            let q = batch.advance(&f, 1.0 / step_s);
            for (lane, columns) in corrected.iter_mut().enumerate() {
                for i in 0..3 {
                    for j in 0..3 {
                        columns[j][i] = q[i][j][lane];
                    }
                }
            }
        }
    }

    /// First Piola-Kirchhoff stress P of a particle after the last update, Pa.
    #[must_use]
    pub fn stress(&self, particle: usize) -> Matrix3<f64> {
        let stress = &self.batches[particle / LANES].stress;
        Matrix3::from_fn(|i, j| stress[i][j][particle % LANES])
    }
}

impl Batch {
    /// `P = F S + 2 eta d' C` with `C = J F^-T` the cofactors of F, and `L = Fdot C^T / J`. Where J is exactly zero the
    /// viscous part vanishes, as it does with a pseudo-inverse.
    #[inline(always)]
    fn advance(&mut self, deformation: &Matrices, steps_per_s: f64) -> Matrices {
        let mut corrected: Matrices = [[[0.0; LANES]; 3]; 3];
        for lane in 0..LANES {
            let f: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| deformation[i][j][lane]));
            let rate: [[f64; 3]; 3] =
                std::array::from_fn(|i| std::array::from_fn(|j| (f[i][j] - self.previous[i][j][lane]) * steps_per_s));
            let strain = |i: usize, j: usize| {
                let product = f[0][i] * f[0][j] + f[1][i] * f[1][j] + f[2][i] * f[2][j];
                (product - if i == j { 1.0 } else { 0.0 }) * 0.5
            };
            let (e00, e11, e22) = (strain(0, 0), strain(1, 1), strain(2, 2));
            let (e01, e02, e12) = (strain(0, 1), strain(0, 2), strain(1, 2));
            let pressure = LAMBDA_PA * (e00 + e11 + e22);
            let twice_mu = 2.0 * MU_PA;
            let s = [
                [pressure + twice_mu * e00, twice_mu * e01, twice_mu * e02],
                [twice_mu * e01, pressure + twice_mu * e11, twice_mu * e12],
                [twice_mu * e02, twice_mu * e12, pressure + twice_mu * e22],
            ];
            let cofactor = [
                [
                    f[1][1] * f[2][2] - f[1][2] * f[2][1],
                    f[1][2] * f[2][0] - f[1][0] * f[2][2],
                    f[1][0] * f[2][1] - f[1][1] * f[2][0],
                ],
                [
                    f[0][2] * f[2][1] - f[0][1] * f[2][2],
                    f[0][0] * f[2][2] - f[0][2] * f[2][0],
                    f[0][1] * f[2][0] - f[0][0] * f[2][1],
                ],
                [
                    f[0][1] * f[1][2] - f[0][2] * f[1][1],
                    f[0][2] * f[1][0] - f[0][0] * f[1][2],
                    f[0][0] * f[1][1] - f[0][1] * f[1][0],
                ],
            ];
            let jacobian = f[0][0] * cofactor[0][0] + f[0][1] * cofactor[0][1] + f[0][2] * cofactor[0][2];
            let inverse = if jacobian == 0.0 { 0.0 } else { 1.0 / jacobian };
            let gradient = |i: usize, j: usize| {
                (rate[i][0] * cofactor[j][0] + rate[i][1] * cofactor[j][1] + rate[i][2] * cofactor[j][2]) * inverse
            };
            let (d00, d11, d22) = (gradient(0, 0), gradient(1, 1), gradient(2, 2));
            let d01 = (gradient(0, 1) + gradient(1, 0)) * 0.5;
            let d02 = (gradient(0, 2) + gradient(2, 0)) * 0.5;
            let d12 = (gradient(1, 2) + gradient(2, 1)) * 0.5;
            let mean = (d00 + d11 + d22) / 3.0;
            let d = [[d00 - mean, d01, d02], [d01, d11 - mean, d12], [d02, d12, d22 - mean]];
            let viscous = 2.0 * VISCOSITY;
            let mut p = [[0.0; 3]; 3];
            for i in 0..3 {
                for j in 0..3 {
                    let elastic = f[i][0] * s[0][j] + f[i][1] * s[1][j] + f[i][2] * s[2][j];
                    let drag = d[i][0] * cofactor[0][j] + d[i][1] * cofactor[1][j] + d[i][2] * cofactor[2][j];
                    p[i][j] = elastic + viscous * drag;
                }
            }
            let a = &self.moment_inverse;
            for i in 0..3 {
                for j in 0..3 {
                    corrected[i][j][lane] = p[i][0] * a[0][j][lane] + p[i][1] * a[1][j][lane] + p[i][2] * a[2][j][lane];
                }
            }
            for i in 0..3 {
                for j in 0..3 {
                    self.stress[i][j][lane] = p[i][j];
                    self.previous[i][j][lane] = f[i][j];
                }
            }
        }
        corrected
    }
}
