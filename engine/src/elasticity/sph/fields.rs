//! Numbers per particle, one column for each component, in the layout of the lattice.

use crate::elasticity::lattice::BLOCK;

/// Length of columns that suffices for structures of some 100 blocks.
///
/// All columns of a simulation begin the same number of cache lines apart. That number is odd, so that equal places of
/// several columns fall into different sets of a cache.
pub const SHORTER: usize = 45 * BLOCK;
/// Length of columns that suffices for structures of some 1,000 blocks.
pub const SHORT: usize = 163 * BLOCK;

/// Bytes of a cache line.
const LINE: usize = 64;

/// `N` numbers per cell of the lattice, stored column after column. Each column begins with a cache line.
#[derive(Debug)]
pub struct Fields<const N: usize> {
    numbers: Vec<f64>,
    /// Index in `numbers` at which the first column begins.
    first: usize,
    /// Distance between the beginnings of two columns.
    stride: usize,
}

/// Returns the distance between the beginnings of two columns with `len` numbers each.
pub fn stride(len: usize) -> usize {
    let of_any_length = (len.div_ceil(BLOCK) | 1) * BLOCK;
    [SHORTER, SHORT].into_iter().find(|short| len <= *short).unwrap_or(of_any_length)
}

impl<const N: usize> Fields<N> {
    /// Creates fields of length `len` that are zero everywhere.
    #[must_use]
    pub fn zero(len: usize) -> Self {
        Self::of_stride(stride(len))
    }

    fn of_stride(stride: usize) -> Self {
        let numbers = vec![0.0_f64; N * stride + BLOCK];
        let first = numbers.as_ptr().align_offset(LINE).min(BLOCK);
        Self { numbers, first, stride }
    }

    /// Returns the distance between the beginnings of two columns.
    #[must_use]
    pub const fn stride(&self) -> usize {
        self.stride
    }

    /// Returns all columns, one after another.
    #[must_use]
    pub fn columns(&self) -> &[f64] {
        &self.numbers[self.first..][..N * self.stride]
    }

    /// Returns all columns for writing, one after another.
    #[must_use]
    pub fn columns_mut(&mut self) -> &mut [f64] {
        &mut self.numbers[self.first..][..N * self.stride]
    }

    /// Returns the numbers at an index.
    #[must_use]
    pub fn at(&self, place: usize) -> [f64; N] {
        std::array::from_fn(|k| self.numbers[self.first + k * self.stride + place])
    }

    /// Sets the numbers at an index.
    pub fn set(&mut self, place: usize, numbers: [f64; N]) {
        for (k, number) in numbers.into_iter().enumerate() {
            self.numbers[self.first + k * self.stride + place] = number;
        }
    }

    /// Sets the numbers to those of `other`, times one factor per index.
    pub fn set_product(&mut self, other: &Self, factor: &Fields<1>) {
        let stride = self.stride;
        for (column, other) in self.columns_mut().chunks_exact_mut(stride).zip(other.columns().chunks_exact(stride)) {
            for ((number, other), factor) in column.iter_mut().zip(other).zip(factor.columns()) {
                *number = other * factor;
            }
        }
    }
}

impl<const N: usize> Clone for Fields<N> {
    /// Copies the numbers; the copy's columns begin with a cache line as well, wherever its memory is.
    fn clone(&self) -> Self {
        let mut copy = Self::of_stride(self.stride);
        copy.columns_mut().copy_from_slice(self.columns());
        copy
    }
}
