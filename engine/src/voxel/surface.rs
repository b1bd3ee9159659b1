//! Height maps of structures, from above or below, and their slices along x and z.

use super::planar::PlaneCell;
use super::structure::Structure;

/// The surface of a structure from which heights are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The greatest y of each column.
    Top,
    /// The least y of each column.
    Bottom,
}

/// A cut through a surface: the columns in order along the cut, with their heights.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slice {
    /// Coordinates `(x, z)` of each column.
    pub columns: Vec<PlaneCell>,
    /// Height (y) of each column.
    pub heights: Vec<i32>,
}

/// Computes all slices of a surface: first those of fixed z (along x), then those of fixed x (along z), each kind
/// ordered by its fixed coordinate. Gaps between columns are dropped, so neighbours in a slice need not be neighbours
/// in space.
#[must_use]
pub fn slices(structure: &Structure, side: Side) -> Vec<Slice> {
    let mut columns: Vec<(PlaneCell, i32)> = structure.cells().iter().map(|c| ((c.x, c.z), c.y)).collect();
    columns.sort_unstable_by_key(|&(column, y)| (column, if side == Side::Top { -i64::from(y) } else { i64::from(y) }));
    columns.dedup_by_key(|&mut (column, _)| column);
    let along_z = cut(&columns, |&((x, _), _)| x);
    columns.sort_unstable_by_key(|&((x, z), _)| (z, x));
    let mut all = cut(&columns, |&((_, z), _)| z);
    all.extend(along_z);
    all
}

fn cut(columns: &[(PlaneCell, i32)], fixed: impl Fn(&(PlaneCell, i32)) -> i32) -> Vec<Slice> {
    columns
        .chunk_by(|a, b| fixed(a) == fixed(b))
        .map(|chunk| Slice {
            columns: chunk.iter().map(|&(column, _)| column).collect(),
            heights: chunk.iter().map(|&(_, y)| y).collect(),
        })
        .collect()
}
