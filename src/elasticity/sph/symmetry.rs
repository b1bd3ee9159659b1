//! Mirror symmetry: of a structure that is its own mirror image only one half is simulated, or one quarter.
//!
//! Gravity and supports are symmetric about upright planes, so the motion is as symmetric as the structure. Beyond a plane of
//! symmetry the first layer is kept as images: particles that are not simulated, but copied from the one that they mirror.

use crate::voxel::{Cell, CellSet};

/// The upright planes about which a structure is symmetric.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symmetry {
    /// For each axis, least plus greatest coordinate, if mirroring about their mean changes nothing.
    sum: [Option<i64>; 3],
}

impl Symmetry {
    /// None at all.
    pub const NONE: Self = Self { sum: [None; 3] };

    /// That of distinct `cells`.
    #[must_use]
    pub fn of(cells: &[Cell]) -> Self {
        let set: CellSet = cells.iter().copied().collect();
        let mut symmetry = Self::NONE;
        for axis in [0, 2] {
            let along = || cells.iter().map(|cell| i64::from(<[i32; 3]>::from(*cell)[axis]));
            let Some(sum) = along().min().zip(along().max()).map(|(least, greatest)| least + greatest) else {
                continue;
            };
            if cells.iter().all(|&cell| set.contains(&mirrored(cell, axis, sum))) {
                symmetry.sum[axis] = Some(sum);
            }
        }
        symmetry
    }

    /// The cell that is simulated for this one, and along which axes it is mirrored.
    #[must_use]
    pub fn fold(&self, cell: Cell) -> (Cell, [bool; 3]) {
        let mut folded = cell;
        let mut flips = [false; 3];
        for axis in 0..3 {
            if self.beyond(cell, axis) > 0
                && let Some(sum) = self.sum[axis]
            {
                folded = mirrored(folded, axis, sum);
                flips[axis] = true;
            }
        }
        (folded, flips)
    }

    /// Whether the cell is simulated or the image of one beside a plane.
    #[must_use]
    pub fn keeps(&self, cell: Cell) -> bool {
        (0..3).all(|axis| self.beyond(cell, axis) <= 1)
    }

    /// How many cells beyond the last simulated one.
    fn beyond(&self, cell: Cell, axis: usize) -> i64 {
        self.sum[axis].map_or(0, |sum| i64::from(<[i32; 3]>::from(cell)[axis]) - sum.div_euclid(2))
    }
}

fn mirrored(cell: Cell, axis: usize, sum: i64) -> Cell {
    let mut place: [i32; 3] = cell.into();
    // Both summands are coordinates of cells, and so is the result.
    place[axis] = (sum - i64::from(place[axis])) as i32;
    place.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_through_and_between_cells() {
        let cells = |row: &[i32]| row.iter().map(|&x| Cell::new(x, 0, 7)).collect::<Vec<_>>();
        let odd = Symmetry::of(&cells(&[-1, 0, 1]));
        assert_eq!(odd.sum, [Some(0), None, Some(14)]);
        assert_eq!(odd.fold(Cell::new(1, 0, 7)), (Cell::new(-1, 0, 7), [true, false, false]));
        assert_eq!(odd.fold(Cell::new(0, 0, 7)), (Cell::new(0, 0, 7), [false; 3]));
        let even = Symmetry::of(&cells(&[2, 3, 4, 5]));
        assert_eq!(even.fold(Cell::new(4, 0, 7)), (Cell::new(3, 0, 7), [true, false, false]));
        assert!(even.keeps(Cell::new(4, 0, 7)) && !even.keeps(Cell::new(5, 0, 7)));
        assert_eq!(Symmetry::of(&cells(&[0, 1, 3])).sum, [None, None, Some(14)]);
        assert_eq!(Symmetry::of(&[]), Symmetry::NONE);
    }
}
