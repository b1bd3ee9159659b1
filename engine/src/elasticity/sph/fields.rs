//! Numbers per particle, one array for each component, in the layout of the lattice, and parts of them for several
//! cores.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::ops::Range;

use crate::elasticity::lattice::BLOCK;

/// `N` numbers per cell of the lattice, stored component after component.
#[derive(Debug, Clone)]
pub struct Fields<const N: usize> {
    components: [Vec<f64>; N],
}

impl<const N: usize> Fields<N> {
    /// Creates fields of length `len` that are zero everywhere.
    #[must_use]
    pub fn zero(len: usize) -> Self {
        Self { components: [(); N].map(|()| vec![0.0; len]) }
    }

    /// Returns the numbers at an index.
    #[must_use]
    pub fn at(&self, place: usize) -> [f64; N] {
        std::array::from_fn(|k| self.components[k][place])
    }

    /// Sets the numbers at an index.
    pub fn set(&mut self, place: usize, numbers: [f64; N]) {
        for (component, number) in self.components.iter_mut().zip(numbers) {
            component[place] = number;
        }
    }

    /// Sets the numbers to those of `other`, times one factor per index.
    pub fn set_product(&mut self, other: &Self, factor: &Fields<1>) {
        for (component, other) in self.components.iter_mut().zip(&other.components) {
            for ((number, other), factor) in component.iter_mut().zip(other).zip(&factor.components[0]) {
                *number = other * factor;
            }
        }
    }

    /// Returns all components for reading.
    #[must_use]
    pub fn view(&self) -> [&[f64]; N] {
        self.components.each_ref().map(Vec::as_slice)
    }

    /// Returns a range of all components for writing.
    #[must_use]
    pub fn part(&mut self, range: Range<usize>) -> Part<'_, N> {
        Part {
            first: range.start,
            components: self.components.each_mut().map(|component| &mut component[range.clone()]),
        }
    }
}

/// Writable range of fields.
#[derive(Debug)]
pub struct Part<'a, const N: usize> {
    /// Index where the range begins.
    pub first: usize,
    /// Numbers of each component in the range.
    pub components: [&'a mut [f64]; N],
}

impl<'a, const N: usize> Part<'a, N> {
    /// Splits the range into the parts before and from an index.
    #[must_use]
    pub fn split_at(self, place: usize) -> (Self, Self) {
        let mut tails: [&'a mut [f64]; N] = [(); N].map(|()| <&mut [f64]>::default());
        let mut next = tails.iter_mut();
        let heads = self.components.map(|component| {
            let (head, tail) = component.split_at_mut(place - self.first);
            if let Some(slot) = next.next() {
                *slot = tail;
            }
            head
        });
        (Self { first: self.first, components: heads }, Self { first: place, components: tails })
    }
}

/// Returns the arrays cut to a length that they all have. If the compiler sees that several arrays are equally long, it
/// compares an index with their length once for all of them.
#[inline(always)]
#[must_use]
pub fn cut<const N: usize>(mut arrays: [&[f64]; N], len: usize) -> [&[f64]; N] {
    for array in &mut arrays {
        *array = &array[..len];
    }
    arrays
}

impl<const N: usize> Part<'_, N> {
    /// Returns the part cut to `len`, see [`cut`].
    #[inline(always)]
    #[must_use]
    pub fn cut(mut self, len: usize) -> Self {
        for component in &mut self.components {
            *component = &mut std::mem::take(component)[..len];
        }
        self
    }

    /// Returns the length of the range.
    #[must_use]
    pub fn len(&self) -> usize {
        self.components.first().map_or(0, |component| component.len())
    }
}

/// Returns the offset of each SIMD vector of a block from the block's first index.
pub fn offsets(lanes: usize) -> impl Iterator<Item = usize> {
    (0..BLOCK).step_by(lanes)
}
