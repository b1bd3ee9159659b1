//! How the passes of a step see fields: columns of a length that the compiler knows, for structures of up to some 1,000
//! blocks, or of any length.
//!
//! A pass reads and writes some eighty columns. If it knows how far apart they begin, one address and one comparison with
//! the length serve all columns of a field; otherwise each access first loads where its column begins.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::fmt::Debug;
use std::ops::Range;

use super::fields::Fields;

/// Columns of a field for reading.
pub trait View<const N: usize>: Copy + Debug + Send + Sync {
    /// Returns a column.
    fn column(&self, k: usize) -> &[f64];
    /// Returns the view with all columns cut to one length in sight of the compiler, which then compares an index with it
    /// once for all of them.
    #[must_use]
    fn levelled(self) -> Self;
}

/// A range of the columns of a field for writing.
pub trait Part<const N: usize>: Debug + Send + Sized {
    /// Returns the index at which the range begins.
    fn first(&self) -> usize;
    /// Returns a column.
    fn column(&self, k: usize) -> &[f64];
    /// Returns a column for writing.
    fn column_mut(&mut self, k: usize) -> &mut [f64];
    /// Splits the range into the parts before and from an index.
    fn split_at(self, place: usize) -> (Self, Self);
    /// Returns the part with all columns cut to one length, see [`View::levelled`].
    #[must_use]
    fn levelled(self) -> Self;
}

/// How the columns of all fields of a simulation are seen.
pub trait Storage: Copy + Debug + Send + Sync + 'static {
    /// Columns for reading.
    type View<'a, const N: usize>: View<N>;
    /// A range of columns for writing.
    type Part<'a, const N: usize>: Part<N>;
    /// Returns all columns for reading.
    fn view<const N: usize>(fields: &Fields<N>) -> Self::View<'_, N>;
    /// Returns at least a range of all columns for writing.
    fn part<const N: usize>(fields: &mut Fields<N>, range: Range<usize>) -> Self::Part<'_, N>;
}

/// Columns of length `LEN`, which must be the fields' stride. Nobody shares them out to several cores.
#[derive(Debug, Clone, Copy)]
pub struct Short<const LEN: usize>;

/// Columns of any length.
#[derive(Debug, Clone, Copy)]
pub struct Long;

/// Range of columns of any length, for writing.
#[derive(Debug)]
pub struct LongPart<'a, const N: usize> {
    first: usize,
    columns: [&'a mut [f64]; N],
}

impl<const LEN: usize> Storage for Short<LEN> {
    type View<'a, const N: usize> = &'a [[f64; LEN]; N];
    type Part<'a, const N: usize> = &'a mut [[f64; LEN]; N];

    fn view<const N: usize>(fields: &Fields<N>) -> Self::View<'_, N> {
        fields.columns().as_chunks().0.try_into().expect("the fields' stride is LEN")
    }

    fn part<const N: usize>(fields: &mut Fields<N>, _: Range<usize>) -> Self::Part<'_, N> {
        fields.columns_mut().as_chunks_mut().0.try_into().expect("the fields' stride is LEN")
    }
}

impl<const N: usize, const LEN: usize> View<N> for &[[f64; LEN]; N] {
    #[inline(always)]
    fn column(&self, k: usize) -> &[f64] {
        &self[k]
    }

    #[inline(always)]
    fn levelled(self) -> Self {
        self
    }
}

impl<const N: usize, const LEN: usize> Part<N> for &mut [[f64; LEN]; N] {
    #[inline(always)]
    fn first(&self) -> usize {
        0
    }

    #[inline(always)]
    fn column(&self, k: usize) -> &[f64] {
        &self[k]
    }

    #[inline(always)]
    fn column_mut(&mut self, k: usize) -> &mut [f64] {
        &mut self[k]
    }

    fn split_at(self, _: usize) -> (Self, Self) {
        unreachable!("structures with short columns have too few blocks to be shared out")
    }

    #[inline(always)]
    fn levelled(self) -> Self {
        self
    }
}

impl Storage for Long {
    type View<'a, const N: usize> = [&'a [f64]; N];
    type Part<'a, const N: usize> = LongPart<'a, N>;

    fn view<const N: usize>(fields: &Fields<N>) -> Self::View<'_, N> {
        let (columns, stride) = (fields.columns(), fields.stride());
        std::array::from_fn(|k| &columns[k * stride..][..stride])
    }

    fn part<const N: usize>(fields: &mut Fields<N>, range: Range<usize>) -> Self::Part<'_, N> {
        let stride = fields.stride();
        let mut columns = fields.columns_mut().chunks_exact_mut(stride);
        let mut next = || columns.next().expect("there are N columns");
        LongPart { first: range.start, columns: [(); N].map(|()| &mut next()[range.clone()]) }
    }
}

impl<const N: usize> View<N> for [&[f64]; N] {
    #[inline(always)]
    fn column(&self, k: usize) -> &[f64] {
        self[k]
    }

    #[inline(always)]
    fn levelled(mut self) -> Self {
        let len = self.first().map_or(0, |column| column.len());
        for column in &mut self {
            *column = &column[..len];
        }
        self
    }
}

impl<'a, const N: usize> Part<N> for LongPart<'a, N> {
    #[inline(always)]
    fn first(&self) -> usize {
        self.first
    }

    #[inline(always)]
    fn column(&self, k: usize) -> &[f64] {
        self.columns[k]
    }

    #[inline(always)]
    fn column_mut(&mut self, k: usize) -> &mut [f64] {
        self.columns[k]
    }

    fn split_at(self, place: usize) -> (Self, Self) {
        let mut tails: [&'a mut [f64]; N] = [(); N].map(|()| <&mut [f64]>::default());
        let mut next = tails.iter_mut();
        let heads = self.columns.map(|column| {
            let (head, tail) = column.split_at_mut(place - self.first);
            *next.next().expect("there are as many heads as tails") = tail;
            head
        });
        (Self { first: self.first, columns: heads }, Self { first: place, columns: tails })
    }

    #[inline(always)]
    fn levelled(mut self) -> Self {
        let len = self.columns.first().map_or(0, |column| column.len());
        for column in &mut self.columns {
            *column = &mut std::mem::take(column)[..len];
        }
        self
    }
}
