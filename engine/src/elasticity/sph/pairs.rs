//! Forces between pairs of neighbours.
//!
//! With `R` the reference vector of a pair and `r` its present one, the force on the first is
//! `(P_i A_i^-1 + P_j A_j^-1) grad W - r k (((F_i + F_j) R . r) / |r|^2 - 2)` with `k = 0.5 * 1e8 W / R^3`: `docs/rules.md#the-published-simulation`'s
//! formula with both hourglass terms combined, which needs no square root. The force on the second is the opposite, so
//! each pair's force is computed once, for the particle from which the other lies ahead.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use pulp::Simd;

use super::stencil::{Matrices, Place, Vectors, Weights, kind};
use super::storage::{Part, Storage, View};
use crate::elasticity::lanes::Lanes;
use crate::elasticity::neighbours::DIRECTIONS;

/// State that the forces depend on.
#[derive(Debug, Clone, Copy)]
pub struct State<'a, T: Storage> {
    /// Displacements.
    pub displacement: T::View<'a, 3>,
    /// Deformation gradients, row by row.
    pub deformation: T::View<'a, 9>,
    /// `P A^-1`, row by row.
    pub corrected_stress: T::View<'a, 9>,
    /// 1 where there is a particle, otherwise 0.
    pub presence: T::View<'a, 1>,
}

impl<T: Storage> State<'_, T> {
    /// Returns the state with all columns cut to one length, see [`View::levelled`].
    #[inline(always)]
    #[must_use]
    pub fn levelled(self) -> Self {
        Self {
            displacement: self.displacement.levelled(),
            deformation: self.deformation.levelled(),
            corrected_stress: self.corrected_stress.levelled(),
            presence: self.presence.levelled(),
        }
    }
}

/// Calls `$visit::<S, _, D>(arguments)` for each direction D.
macro_rules! each_direction {
    ($visit:ident($($argument:expr),*)) => {
        $visit::<S, _, 0>($($argument),*);
        $visit::<S, _, 1>($($argument),*);
        $visit::<S, _, 2>($($argument),*);
        $visit::<S, _, 3>($($argument),*);
        $visit::<S, _, 4>($($argument),*);
        $visit::<S, _, 5>($($argument),*);
        $visit::<S, _, 6>($($argument),*);
        $visit::<S, _, 7>($($argument),*);
        $visit::<S, _, 8>($($argument),*);
        $visit::<S, _, 9>($($argument),*);
        $visit::<S, _, 10>($($argument),*);
        $visit::<S, _, 11>($($argument),*);
        $visit::<S, _, 12>($($argument),*);
    };
}

/// State of the particles whose forces are computed.
#[derive(Debug, Clone, Copy)]
struct Own<S: Simd> {
    displacement: Vectors<S>,
    deformation: Matrices<S>,
    corrected_stress: Matrices<S>,
    presence: Lanes<S>,
}

/// Computes the forces on these particles from those ahead. `to` has three components for each direction.
#[inline(always)]
pub fn pull<S: Simd, T: Storage>(
    place: &Place<'_, S>,
    state: &State<'_, T>,
    weights: &Weights,
    to: &mut T::Part<'_, 39>,
) {
    let own = Own {
        displacement: place.load(state.displacement, place.own),
        deformation: rows(place.load(state.deformation, place.own)),
        corrected_stress: rows(place.load(state.corrected_stress, place.own)),
        presence: Lanes::load(place.simd, state.presence.column(0), place.own),
    };
    each_direction!(pull_along(place, state, weights, &own, to));
}

#[inline(always)]
fn pull_along<S: Simd, T: Storage, const D: usize>(
    place: &Place<'_, S>,
    state: &State<'_, T>,
    weights: &Weights,
    own: &Own<S>,
    to: &mut T::Part<'_, 39>,
) {
    if place.block.pulling[D] == 0 {
        return;
    }
    let ahead = place.block.pulling[D] as usize + place.offset;
    let kind = const { kind(D) };
    let is_pair = own.presence * Lanes::load(place.simd, state.presence.column(0), ahead);
    let gradient = place.splat(weights.gradient[kind]);
    let r = present_vector::<S, D>(place, place.load(state.displacement, ahead), own.displacement);
    let stretched = along::<S, D>(place, &own.deformation, state.deformation, ahead);
    let stress = along::<S, D>(place, &own.corrected_stress, state.corrected_stress, ahead);
    let ratio = dot(stretched, r) * dot(r, r).reciprocal();
    let spring = place.splat(weights.hourglass[kind]) * (ratio - place.splat(2.0));
    let at = place.own - to.first();
    for k in 0..3 {
        let force = r[k].subtract_product_from(spring, stress[k] * gradient);
        // Select, do not multiply: beside a particle that diverged, empty cells hold NaN.
        force.where_positive(is_pair, place.splat(0.0)).store(to.column_mut(3 * D + k), at);
    }
}

/// Returns the sum of the forces on these particles from those ahead and behind. If particles share cells (`SHARED`),
/// each force counts as many times as there are particles in the other cell.
#[inline(always)]
pub fn sum<S: Simd, const SHARED: bool>(
    place: &Place<'_, S>,
    forces: impl View<39>,
    multiplicity: &[f64],
) -> Vectors<S> {
    let mut sum = [place.splat(0.0); 3];
    if SHARED {
        each_direction!(add_shared_forces(place, forces, multiplicity, &mut sum));
    } else {
        each_direction!(add_forces(place, forces, &mut sum));
    }
    sum
}

#[inline(always)]
fn add_forces<S: Simd, V: View<39>, const D: usize>(place: &Place<'_, S>, forces: V, sum: &mut Vectors<S>) {
    let Some((_, behind)) = place.beside::<D>() else { return };
    for k in 0..3 {
        let pulled = Lanes::load(place.simd, forces.column(3 * D + k), place.own);
        sum[k] = sum[k] + (pulled - Lanes::load(place.simd, forces.column(3 * D + k), behind));
    }
}

#[inline(always)]
fn add_shared_forces<S: Simd, V: View<39>, const D: usize>(
    place: &Place<'_, S>,
    forces: V,
    multiplicity: &[f64],
    sum: &mut Vectors<S>,
) {
    let Some((ahead, behind)) = place.beside::<D>() else { return };
    for k in 0..3 {
        let pulled = Lanes::load(place.simd, forces.column(3 * D + k), place.own);
        let pulling = Lanes::load(place.simd, forces.column(3 * D + k), behind);
        let pulled = pulled * Lanes::load(place.simd, multiplicity, ahead);
        sum[k] = sum[k] + (pulled - pulling * Lanes::load(place.simd, multiplicity, behind));
    }
}

/// Returns the matrices with these entries, row by row.
#[inline(always)]
fn rows<S: Simd>(m: [Lanes<S>; 9]) -> Matrices<S> {
    [[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]]
}

/// Returns `(A + B) R` for the direction's `R`, with A the matrices of these particles and B those of the ones ahead.
#[inline(always)]
fn along<S: Simd, const D: usize>(
    place: &Place<'_, S>,
    own: &Matrices<S>,
    matrix: impl View<9>,
    ahead: usize,
) -> Vectors<S> {
    let mut sum = own[0];
    for i in 0..3 {
        let mut ahead_row = own[i];
        for k in 0..3 {
            if const { DIRECTIONS[D] }[k] != 0 {
                ahead_row[k] = Lanes::load(place.simd, matrix.column(3 * i + k), ahead);
            }
        }
        sum[i] = signed_sum::<S, D>(own[i]) + signed_sum::<S, D>(ahead_row);
    }
    sum
}

/// Returns `row . R` for the direction's `R`, whose last non-zero component is 1.
#[inline(always)]
fn signed_sum<S: Simd, const D: usize>(row: Vectors<S>) -> Lanes<S> {
    let [x, y, z] = const { DIRECTIONS[D] };
    let last = if z != 0 {
        row[2]
    } else if y != 0 {
        row[1]
    } else {
        row[0]
    };
    let second = match y {
        1 if z != 0 => last + row[1],
        -1 if z != 0 => last - row[1],
        _ => last,
    };
    match x {
        1 if y != 0 || z != 0 => second + row[0],
        -1 if y != 0 || z != 0 => second - row[0],
        _ => second,
    }
}

/// Returns `R + u_j - u_i` for the direction's `R`.
#[inline(always)]
fn present_vector<S: Simd, const D: usize>(place: &Place<'_, S>, to: Vectors<S>, from: Vectors<S>) -> Vectors<S> {
    let direction = const { DIRECTIONS[D] };
    let mut vector = to;
    for k in 0..3 {
        vector[k] = to[k] - from[k];
        if direction[k] != 0 {
            vector[k] = vector[k] + place.splat(f64::from(direction[k]));
        }
    }
    vector
}

#[inline(always)]
fn dot<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Lanes<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
