//! Sums over the neighbours of eight particles at a time, direction by direction.
//!
//! The gradient of the kernel is `g R`, with one number `g` each for faces, edges and corners, and components of `R`
//! that are -1, 0 or 1. A sum over neighbours of `value (x) grad W` therefore takes only additions, and one
//! multiplication for each of the three kinds.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::Vector3;
use pulp::Simd;

use super::storage::View;
use crate::elasticity::lanes::Lanes;
use crate::elasticity::lattice::{BLOCK, Block};
use crate::elasticity::neighbours::{DIRECTIONS, kernel, kernel_gradient};

/// A 3 x 3 matrix for each lane, row by row.
pub type Matrices<S> = [[Lanes<S>; 3]; 3];
/// A vector for each lane.
pub type Vectors<S> = [Lanes<S>; 3];

/// Strength of the hourglass control, Pa.
const HOURGLASS_PA: f64 = 1e8;

/// First direction of each kind: faces, edges, corners.
const KINDS: [usize; 3] = [0, 3, 9];

/// Returns the kind of a direction: 0 for faces, 1 for edges, 2 for corners.
pub const fn kind(direction: usize) -> usize {
    if direction < KINDS[1] {
        0
    } else if direction < KINDS[2] {
        1
    } else {
        2
    }
}

/// Weights of the kernel for each kind of direction.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// `grad W = gradient * R`, for faces, edges and corners.
    pub gradient: [f64; 3],
    /// `0.5 * 1e8 W / R^3`, for faces, edges and corners.
    pub hourglass: [f64; 3],
}

impl Weights {
    /// Computes the weights of the kernel.
    #[must_use]
    pub fn new() -> Self {
        let reference = |kind: usize| Vector3::from(DIRECTIONS[KINDS[kind]].map(f64::from));
        Self {
            gradient: std::array::from_fn(|kind| kernel_gradient(&reference(kind)).x),
            hourglass: std::array::from_fn(|kind| {
                let distance = reference(kind).norm();
                0.5 * HOURGLASS_PA * kernel(distance) / distance.powi(3)
            }),
        }
    }
}

/// Sums over all directions, with one multiplication for each kind: `$visit::<S, _, D>(arguments, &mut sum)` adds the
/// contribution of direction D, and `$fold(sum, weight, total)` returns `sum * weight + total`.
macro_rules! sum_by_kind {
    ($weights:expr, $zero:expr, $fold:ident, $visit:ident($($argument:expr),*)) => {{
        let mut sum = $zero;
        $visit::<S, _, 0>($($argument,)* &mut sum);
        $visit::<S, _, 1>($($argument,)* &mut sum);
        $visit::<S, _, 2>($($argument,)* &mut sum);
        let total = $fold(sum, $weights[0], $zero);
        let mut sum = $zero;
        $visit::<S, _, 3>($($argument,)* &mut sum);
        $visit::<S, _, 4>($($argument,)* &mut sum);
        $visit::<S, _, 5>($($argument,)* &mut sum);
        $visit::<S, _, 6>($($argument,)* &mut sum);
        $visit::<S, _, 7>($($argument,)* &mut sum);
        $visit::<S, _, 8>($($argument,)* &mut sum);
        let total = $fold(sum, $weights[1], total);
        let mut sum = $zero;
        $visit::<S, _, 9>($($argument,)* &mut sum);
        $visit::<S, _, 10>($($argument,)* &mut sum);
        $visit::<S, _, 11>($($argument,)* &mut sum);
        $visit::<S, _, 12>($($argument,)* &mut sum);
        $fold(sum, $weights[2], total)
    }};
}

/// Returns the offset of each SIMD vector of a block from the block's first index.
pub fn offsets(lanes: usize) -> impl Iterator<Item = usize> {
    (0..BLOCK).step_by(lanes)
}

/// Eight particles, or as many of them as a SIMD vector holds.
#[derive(Debug, Clone, Copy)]
pub struct Place<'a, S> {
    /// SIMD instructions of the processor.
    pub simd: S,
    /// Block that contains the particles.
    pub block: &'a Block,
    /// Offset of the first particle in the block.
    pub offset: usize,
    /// Index of the first particle in a field.
    pub own: usize,
}

impl<'a, S: Simd> Place<'a, S> {
    /// Selects the particles of a block from an offset.
    #[inline(always)]
    pub fn new(simd: S, block: &'a Block, offset: usize) -> Self {
        Self { simd, block, offset, own: block.slot + offset }
    }

    /// Returns the indices of the first neighbours ahead and behind in direction `D`, or `None` if no particle has one.
    #[inline(always)]
    pub fn beside<const D: usize>(&self) -> Option<(usize, usize)> {
        let (ahead, behind) = (self.block.ahead[D] as usize, self.block.behind[D] as usize);
        if ahead + behind > 0 { Some((ahead + self.offset, behind + self.offset)) } else { None }
    }

    /// Loads the numbers of `N` columns at an index.
    #[inline(always)]
    pub fn load<const N: usize>(&self, fields: impl View<N>, at: usize) -> [Lanes<S>; N] {
        let mut loaded = [self.splat(0.0); N];
        for k in 0..N {
            loaded[k] = Lanes::load(self.simd, fields.column(k), at);
        }
        loaded
    }

    /// Returns a number in all lanes.
    #[inline(always)]
    pub fn splat(&self, number: f64) -> Lanes<S> {
        Lanes::splat(self.simd, number)
    }

    /// Returns `sum_j value_j (x) grad W` over neighbours ahead and behind, with `grad W` along the vector to the
    /// neighbour.
    #[inline(always)]
    pub fn outer_sum(&self, value: impl View<3>, weights: &Weights) -> Matrices<S> {
        let zero = [[self.splat(0.0); 3]; 3];
        let [faces, edges, corners] = weights.gradient;
        let weights = [self.splat(faces), self.splat(edges), self.splat(corners)];
        sum_by_kind!(weights, zero, fold_matrices, add_outer(self, value))
    }
}

#[inline(always)]
fn fold_vectors<S: Simd>(sum: Vectors<S>, weight: Lanes<S>, total: Vectors<S>) -> Vectors<S> {
    [sum[0].mul_add(weight, total[0]), sum[1].mul_add(weight, total[1]), sum[2].mul_add(weight, total[2])]
}

#[inline(always)]
fn fold_matrices<S: Simd>(sum: Matrices<S>, weight: Lanes<S>, total: Matrices<S>) -> Matrices<S> {
    [
        fold_vectors(sum[0], weight, total[0]),
        fold_vectors(sum[1], weight, total[1]),
        fold_vectors(sum[2], weight, total[2]),
    ]
}

#[inline(always)]
fn add_outer<S: Simd, V: View<3>, const D: usize>(place: &Place<'_, S>, value: V, sum: &mut Matrices<S>) {
    let Some((ahead, behind)) = place.beside::<D>() else { return };
    let direction = const { DIRECTIONS[D] };
    for i in 0..3 {
        let difference =
            Lanes::load(place.simd, value.column(i), ahead) - Lanes::load(place.simd, value.column(i), behind);
        for k in 0..3 {
            match direction[k] {
                1 => sum[i][k] = sum[i][k] + difference,
                -1 => sum[i][k] = sum[i][k] - difference,
                _ => {}
            }
        }
    }
}
