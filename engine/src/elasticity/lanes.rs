//! Numbers in the lanes of SIMD vectors, with the operators of ordinary numbers.

#![expect(
    clippy::inline_always,
    reason = "so that the operations are compiled for the processor that the caller chose"
)]

use std::ops::{Add, Mul, Sub};

use pulp::Simd;

/// Greatest number of lanes of a vector.
pub const MAX_LANES: usize = 8;

/// One number for each lane.
#[derive(Debug, Clone, Copy)]
pub struct Lanes<S: Simd> {
    simd: S,
    value: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// Returns the same number in each lane.
    #[inline(always)]
    pub fn splat(simd: S, number: f64) -> Self {
        Self { simd, value: simd.splat_f64s(number) }
    }

    /// Loads the numbers at `from[at..]`, one for each lane.
    #[inline(always)]
    pub fn load(simd: S, from: &[f64], at: usize) -> Self {
        Self { simd, value: S::as_simd_f64s(&from[at..at + S::F64_LANES]).0[0] }
    }

    /// Stores the numbers at `to[at..]`.
    #[inline(always)]
    pub fn store(self, to: &mut [f64], at: usize) {
        S::as_mut_simd_f64s(&mut to[at..at + S::F64_LANES]).0[0] = self.value;
    }

    /// Returns `self * factor + term`, rounded once if the processor supports that.
    #[inline(always)]
    pub fn mul_add(self, factor: Self, term: Self) -> Self {
        Self { simd: self.simd, value: self.simd.mul_add_e_f64s(self.value, factor.value, term.value) }
    }

    /// Returns `term - self * factor`, rounded once if the processor supports that.
    #[inline(always)]
    pub fn subtract_product_from(self, factor: Self, term: Self) -> Self {
        Self { simd: self.simd, value: self.simd.negate_mul_add_e_f64s(self.value, factor.value, term.value) }
    }

    /// Returns `1 / self`.
    #[inline(always)]
    pub fn reciprocal(self) -> Self {
        Self { simd: self.simd, value: self.simd.div_f64s(self.simd.splat_f64s(1.0), self.value) }
    }

    /// Returns `self` in lanes where `decider` is above zero, otherwise `other`.
    #[inline(always)]
    pub fn where_positive(self, decider: Self, other: Self) -> Self {
        let mask = self.simd.less_than_f64s(self.simd.splat_f64s(0.0), decider.value);
        Self { simd: self.simd, value: self.simd.select_f64s(mask, self.value, other.value) }
    }

    /// Returns zero in lanes where `decider` is exactly zero, otherwise `self`.
    #[inline(always)]
    pub fn unless_zero(self, decider: Self) -> Self {
        let zero = self.simd.splat_f64s(0.0);
        let mask = self.simd.equal_f64s(decider.value, zero);
        Self { simd: self.simd, value: self.simd.select_f64s(mask, zero, self.value) }
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { simd: self.simd, value: self.simd.add_f64s(self.value, other.value) }
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { simd: self.simd, value: self.simd.sub_f64s(self.value, other.value) }
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { simd: self.simd, value: self.simd.mul_f64s(self.value, other.value) }
    }
}
