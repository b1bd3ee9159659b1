//! A cell of the block grid, its neighbours, and the boxes that bound sets of cells.

use std::collections::{HashMap, HashSet};

use serde::{Deserialize, Serialize};

/// Greatest absolute x and z (the edge of a Minecraft world).
pub const MAX_HORIZONTAL: i32 = 30_000_000;
/// Least y (the deepest a world can be built).
pub const MIN_Y: i32 = -2_048;
/// Greatest y (the highest a world can be built).
pub const MAX_Y: i32 = 2_047;

/// A cell of the block grid; `y` is up and the ground surface is `y <= 0` (SPEC 1).
///
/// Serialised as `[x, y, z]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "[i32; 3]", into = "[i32; 3]")]
pub struct Cell {
    /// East.
    pub x: i32,
    /// Up.
    pub y: i32,
    /// South.
    pub z: i32,
}

/// Keyed by cell, with a hasher that a crafted log cannot steer into collisions. Never iterate it into a result.
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
    /// The cell at `(x, y, z)`.
    #[must_use]
    pub const fn new(x: i32, y: i32, z: i32) -> Self {
        Self { x, y, z }
    }

    /// This cell moved by `(dx, dy, dz)`.
    #[must_use]
    pub const fn offset(self, dx: i32, dy: i32, dz: i32) -> Self {
        Self::new(self.x + dx, self.y + dy, self.z + dz)
    }

    /// The six cells that share a face with this one.
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

    /// The four cells beside this one on its level.
    #[must_use]
    pub const fn side_neighbours(self) -> [Self; 4] {
        [self.offset(1, 0, 0), self.offset(-1, 0, 0), self.offset(0, 0, 1), self.offset(0, 0, -1)]
    }

    /// Manhattan distance to `other`, in cells.
    #[must_use]
    pub const fn l1_distance(self, other: Self) -> i64 {
        (self.x.abs_diff(other.x) as i64) + (self.y.abs_diff(other.y) as i64) + (self.z.abs_diff(other.z) as i64)
    }

    /// Whether every coordinate lies in the supported range.
    #[must_use]
    pub const fn in_range(self) -> bool {
        self.x.abs() <= MAX_HORIZONTAL && self.z.abs() <= MAX_HORIZONTAL && self.y >= MIN_Y && self.y <= MAX_Y
    }
}

/// The smallest axis-aligned box around a set of cells, both corners included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bounds {
    /// Least coordinate on each axis.
    pub min: Cell,
    /// Greatest coordinate on each axis.
    pub max: Cell,
}

impl Bounds {
    /// The bounds of `cells`, or `None` where there are none.
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

    /// Greatest minus least coordinate per axis `[dx, dy, dz]`: one less than the blocks spanned.
    #[must_use]
    pub const fn extent(&self) -> [i64; 3] {
        [
            self.max.x as i64 - self.min.x as i64,
            self.max.y as i64 - self.min.y as i64,
            self.max.z as i64 - self.min.z as i64,
        ]
    }

    /// The centre cell, rounded down on each axis (floor division, also below zero).
    #[must_use]
    pub const fn centre(&self) -> Cell {
        Cell::new(
            (self.min.x + self.max.x).div_euclid(2),
            (self.min.y + self.max.y).div_euclid(2),
            (self.min.z + self.max.z).div_euclid(2),
        )
    }

    /// Whether `(x, z)` lies outside the box seen from above.
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
