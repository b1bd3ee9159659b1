//! Cells of the block grid, their neighbours, and the boxes that bound sets of cells.

use std::collections::{HashMap, HashSet};
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// Greatest absolute value of x and z (the edge of a Minecraft world).
pub const MAX_HORIZONTAL: i32 = 30_000_000;
/// Least y (the lower bound of what Minecraft worlds can hold).
pub const MIN_Y: i32 = -2_048;
/// Greatest y (the upper bound of what Minecraft worlds can hold).
pub const MAX_Y: i32 = 2_047;

/// Returns the supported range of a coordinate on axis 0 (x), 1 (y) or 2 (z).
#[must_use]
pub const fn range(axis: usize) -> RangeInclusive<i32> {
    if axis == 1 { MIN_Y..=MAX_Y } else { -MAX_HORIZONTAL..=MAX_HORIZONTAL }
}

/// A cell of the block grid; `y` is up and the ground surface is `y <= 0` (`docs/rules.md#words`).
///
/// Serialised as `[x, y, z]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "[i32; 3]", into = "[i32; 3]")]
pub struct Cell {
    /// Coordinate that increases towards the east.
    pub x: i32,
    /// Height, which increases upwards.
    pub y: i32,
    /// Coordinate that increases towards the south.
    pub z: i32,
}

/// A map keyed by cell, with a seeded hasher so that a crafted log cannot provoke collisions.
///
/// The iteration order varies from run to run, so results must never depend on it.
pub type CellMap<V> = HashMap<Cell, V, foldhash::fast::RandomState>;
/// A set of cells; see [`CellMap`].
pub type CellSet = HashSet<Cell, foldhash::fast::RandomState>;

impl From<[i32; 3]> for Cell {
    fn from([x, y, z]: [i32; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Cell> for [i32; 3] {
    fn from(cell: Cell) -> Self {
        [cell.x, cell.y, cell.z]
    }
}

impl Cell {
    /// Creates the cell at `(x, y, z)`.
    #[must_use]
    pub const fn new(x: i32, y: i32, z: i32) -> Self {
        Self { x, y, z }
    }

    /// Returns the cell at an offset of `(dx, dy, dz)` from this one.
    #[must_use]
    pub const fn offset(self, dx: i32, dy: i32, dz: i32) -> Self {
        Self::new(self.x + dx, self.y + dy, self.z + dz)
    }

    /// Returns the six cells that share a face with this one.
    #[must_use]
    pub const fn face_neighbours(self) -> [Self; 6] {
        [
            self.offset(1, 0, 0),
            self.offset(-1, 0, 0),
            self.offset(0, 1, 0),
            self.offset(0, -1, 0),
            self.offset(0, 0, 1),
            self.offset(0, 0, -1),
        ]
    }

    /// Returns the four horizontal neighbours of this cell.
    #[must_use]
    pub const fn side_neighbours(self) -> [Self; 4] {
        [self.offset(1, 0, 0), self.offset(-1, 0, 0), self.offset(0, 0, 1), self.offset(0, 0, -1)]
    }

    /// Returns the Manhattan distance to `other`, in cells.
    #[must_use]
    pub const fn l1_distance(self, other: Self) -> i64 {
        (self.x.abs_diff(other.x) as i64) + (self.y.abs_diff(other.y) as i64) + (self.z.abs_diff(other.z) as i64)
    }

    /// Returns whether every coordinate lies in the supported range.
    #[must_use]
    pub const fn in_range(self) -> bool {
        self.x.abs() <= MAX_HORIZONTAL && self.z.abs() <= MAX_HORIZONTAL && self.y >= MIN_Y && self.y <= MAX_Y
    }
}

/// The smallest axis-aligned box that contains a set of cells; both corners are inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bounds {
    /// Least coordinate on each axis.
    pub min: Cell,
    /// Greatest coordinate on each axis.
    pub max: Cell,
}

impl Bounds {
    /// Computes the bounds of `cells`. Returns `None` if there are no cells.
    #[must_use]
    pub fn of(cells: impl IntoIterator<Item = Cell>) -> Option<Self> {
        let mut cells = cells.into_iter();
        let first = cells.next()?;
        let start = Self { min: first, max: first };
        Some(cells.fold(start, |b, c| Self {
            min: Cell::new(b.min.x.min(c.x), b.min.y.min(c.y), b.min.z.min(c.z)),
            max: Cell::new(b.max.x.max(c.x), b.max.y.max(c.y), b.max.z.max(c.z)),
        }))
    }

    /// Returns the greatest minus the least coordinate per axis, `[dx, dy, dz]`: one less than the blocks spanned.
    #[must_use]
    pub const fn extent(&self) -> [i64; 3] {
        [
            self.max.x as i64 - self.min.x as i64,
            self.max.y as i64 - self.min.y as i64,
            self.max.z as i64 - self.min.z as i64,
        ]
    }

    /// Returns the centre cell, rounded down on each axis (floor division, also for negative coordinates).
    #[must_use]
    pub const fn centre(&self) -> Cell {
        Cell::new(
            (self.min.x + self.max.x).div_euclid(2),
            (self.min.y + self.max.y).div_euclid(2),
            (self.min.z + self.max.z).div_euclid(2),
        )
    }

    /// Returns whether `(x, z)` lies outside the box as seen from above.
    #[must_use]
    pub const fn is_outside_in_plan(&self, x: i32, z: i32) -> bool {
        x < self.min.x || x > self.max.x || z < self.min.z || z > self.max.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centre_rounds_down_below_zero_too() {
        let bounds = Bounds { min: Cell::new(-3, -1, 2), max: Cell::new(0, 2, 5) };
        assert_eq!(bounds.centre(), Cell::new(-2, 0, 3));
    }

    #[test]
    fn nothing_has_no_bounds() {
        assert_eq!(Bounds::of([]), None);
    }
}
