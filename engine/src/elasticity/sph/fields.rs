//! Numbers per particle, one array for each component, in the places of the lattice; and their parts for several cores.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use crate::elasticity::lattice::BLOCK;

/// `N` numbers per place: component after component.
#[derive(Debug, Clone)]
pub struct Fields<const N: usize> {
    components: [Vec<f64>; N],
}

impl<const N: usize> Fields<N> {
    /// Zero everywhere, in `len` places.
    #[must_use]
    pub fn zero(len: usize) -> Self {
        Self { components: [(); N].map(|()| vec![0.0; len]) }
    }

    /// The numbers at a place.
    #[must_use]
    pub fn at(&self, place: usize) -> [f64; N] {
        std::array::from_fn(|k| self.components[k][place])
    }

    /// Puts numbers at a place.
    pub fn set(&mut self, place: usize, numbers: [f64; N]) {
        for (component, number) in self.components.iter_mut().zip(numbers) {
            component[place] = number;
        }
    }

    /// Makes this another's numbers, times one number per place.
    pub fn set_product(&mut self, other: &Self, factor: &Fields<1>) {
        for (component, other) in self.components.iter_mut().zip(&other.components) {
            for ((number, other), factor) in component.iter_mut().zip(other).zip(&factor.components[0]) {
                *number = other * factor;
            }
        }
    }

    /// All places, to read.
    #[must_use]
    pub fn view(&self) -> [&[f64]; N] {
        self.components.each_ref().map(Vec::as_slice)
    }

    /// All places, to write.
    #[must_use]
    pub fn part(&mut self) -> Part<'_, N> {
        Part { first: 0, components: self.components.each_mut().map(Vec::as_mut_slice) }
    }
}

/// A range of places, to write.
#[derive(Debug)]
pub struct Part<'a, const N: usize> {
    /// The place where it begins.
    pub first: usize,
    /// Its numbers.
    pub components: [&'a mut [f64]; N],
}

impl<'a, const N: usize> Part<'a, N> {
    /// The parts before and from a place.
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

/// The same arrays, cut to a length that they all have. Where the compiler sees that several arrays are equally long, it
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
    /// The same part, known to be `len` long, see [`cut`].
    #[inline(always)]
    #[must_use]
    pub fn cut(mut self, len: usize) -> Self {
        for component in &mut self.components {
            *component = &mut std::mem::take(component)[..len];
        }
        self
    }

    /// How many places it has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.components.first().map_or(0, |component| component.len())
    }
}

/// Vectors of a block: where each begins, counted from the block's first place.
pub fn offsets(lanes: usize) -> impl Iterator<Item = usize> {
    (0..BLOCK).step_by(lanes)
}
