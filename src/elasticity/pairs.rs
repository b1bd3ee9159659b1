//! Forces between pairs of neighbours, grouped by direction so that each group's reference vector is known when compiled.
//!
//! With `R` the reference vector of a pair and `r` its present one, the force on the first is
//! `(P_i A_i^-1 + P_j A_j^-1) grad W - r k (((F_i + F_j) R . r) / |r|^2 - 2)` with `k = 0.5 * 1e8 W / R^3`: SPEC 4's
//! formula with both hourglass terms put together, which needs no square root. The second gets the opposite.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::Vector3;

use super::neighbours::{kernel, kernel_gradient, particles_by_cell};
use crate::voxel::Cell;

/// Three coordinates and a zero: a quarter of the loads, and a width that processors have.
pub type Vec4 = [f64; 4];
/// The columns of a 3 x 3 matrix.
pub type Columns = [Vec4; 3];

/// Strength of the hourglass control, Pa.
const HOURGLASS_PA: f64 = 1e8;

/// One of each two opposite offsets to a neighbour.
const DIRECTIONS: [[i32; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [1, -1, -1],
];

/// The pairs of one direction.
#[derive(Debug)]
struct Group {
    /// `grad W = gradient * R`.
    gradient: f64,
    /// `0.5 * 1e8 W / R^3`.
    hourglass: f64,
    /// First and second particle; the second lies in the group's direction.
    pairs: Vec<(u32, u32)>,
}

/// All pairs of neighbours, in the order of [`DIRECTIONS`].
#[derive(Debug)]
pub struct Pairs {
    groups: [Group; 13],
}

/// State of the particles that pair forces need.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    /// Present positions.
    pub position: &'a [Vec4],
    /// Deformation gradients.
    pub deformation: &'a [Columns],
    /// `P A^-1`.
    pub corrected_stress: &'a [Columns],
}

impl Pairs {
    /// The pairs among particles in `cells`; particles in the same cell are none.
    #[must_use]
    pub fn among(cells: &[Cell]) -> Self {
        let at = particles_by_cell(cells);
        let groups = DIRECTIONS.map(|[x, y, z]| {
            let reference = Vector3::new(f64::from(x), f64::from(y), f64::from(z));
            let distance = reference.norm();
            let mut pairs = Vec::new();
            for (i, cell) in (0u32..).zip(cells) {
                let others = at.get(&cell.offset(x, y, z)).into_iter().flatten();
                pairs.extend(others.map(|&j| (i, j)));
            }
            Group {
                gradient: kernel_gradient(&reference).dot(&reference) / reference.norm_squared(),
                hourglass: 0.5 * HOURGLASS_PA * kernel(distance) / distance.powi(3),
                pairs,
            }
        });
        Self { groups }
    }

    /// Adds the forces of all pairs to `force`.
    #[inline(always)]
    pub fn add_forces(&self, field: Field<'_>, force: &mut [Vec4]) {
        let g = &self.groups;
        sweep::<1, 0, 0>(&g[0], field, force);
        sweep::<0, 1, 0>(&g[1], field, force);
        sweep::<0, 0, 1>(&g[2], field, force);
        sweep::<1, 1, 0>(&g[3], field, force);
        sweep::<1, -1, 0>(&g[4], field, force);
        sweep::<1, 0, 1>(&g[5], field, force);
        sweep::<1, 0, -1>(&g[6], field, force);
        sweep::<0, 1, 1>(&g[7], field, force);
        sweep::<0, 1, -1>(&g[8], field, force);
        sweep::<1, 1, 1>(&g[9], field, force);
        sweep::<1, 1, -1>(&g[10], field, force);
        sweep::<1, -1, 1>(&g[11], field, force);
        sweep::<1, -1, -1>(&g[12], field, force);
    }
}

#[inline(always)]
fn sweep<const X: i8, const Y: i8, const Z: i8>(group: &Group, field: Field<'_>, force: &mut [Vec4]) {
    for &(i, j) in &group.pairs {
        let (i, j) = (i as usize, j as usize);
        let stretched = along::<X, Y, Z>(&field.deformation[i], &field.deformation[j]);
        let pushed = along::<X, Y, Z>(&field.corrected_stress[i], &field.corrected_stress[j]);
        let (a, b) = (&field.position[i], &field.position[j]);
        let r: Vec4 = std::array::from_fn(|k| b[k] - a[k]);
        let hourglass = group.hourglass * (dot(&stretched, &r) / dot(&r, &r) - 2.0);
        let pair: Vec4 = std::array::from_fn(|k| pushed[k] * group.gradient - r[k] * hourglass);
        for k in 0..4 {
            force[i][k] += pair[k];
        }
        for k in 0..4 {
            force[j][k] -= pair[k];
        }
    }
}

/// `(A + B) R` for `R = (X, Y, Z)`.
#[inline(always)]
fn along<const X: i8, const Y: i8, const Z: i8>(a: &Columns, b: &Columns) -> Vec4 {
    let mut sum = [0.0; 4];
    for (column, sign) in [(0, X), (1, Y), (2, Z)] {
        if sign == 1 {
            for k in 0..4 {
                sum[k] += a[column][k] + b[column][k];
            }
        } else if sign == -1 {
            for k in 0..4 {
                sum[k] -= a[column][k] + b[column][k];
            }
        }
    }
    sum
}

#[inline(always)]
fn dot(a: &Vec4, b: &Vec4) -> f64 {
    (a[0] * b[0] + a[2] * b[2]) + a[1] * b[1]
}
