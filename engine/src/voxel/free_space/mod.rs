//! Movement of a box through free space, for the published exit rule: can the box leave a build?
//!
//! The anchor of the box is its corner of least x, y and z. Two searches find the same: `by_lines` goes along lines of
//! anchors, `by_regions` from one free region to the next. A block is in the way on as many lines as the box is wide and high,
//! which for a large box are more than there are regions. Neither looks at air for its own sake: the cost depends on the
//! blocks, not on the volume.

mod by_lines;
mod by_regions;
mod regions;

use super::cell::{Bounds, Cell};

/// Greatest number of lines of anchors for each block with which the search goes by lines. In halls full of scattered blocks
/// both took the same time for boxes of 6 x 6 x 6 when this was chosen; the search by regions has become twice as fast there.
const MAX_LINES: i32 = 25;

/// Size of a moving box in cells along x, y and z; each is at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoxSize {
    /// Size along x.
    pub x: i32,
    /// Size along y (height).
    pub y: i32,
    /// Size along z.
    pub z: i32,
}

/// The free space of a moving box among solid cells.
#[derive(Debug)]
pub struct FreeSpace<'a> {
    solid: &'a [Cell],
    /// The least and the greatest level of the anchor.
    levels: [i32; 2],
    size: BoxSize,
}

impl<'a> FreeSpace<'a> {
    /// Describes the space that `solid` leaves to a box of `size`, whose anchor stays within the heights of `bounds`.
    #[must_use]
    pub const fn new(solid: &'a [Cell], bounds: &Bounds, size: BoxSize) -> Self {
        Self { solid, levels: [bounds.min.y, bounds.max.y], size }
    }

    /// Returns whether a box whose anchor starts at one of `starts` can leave. Each step goes to one of the four sides,
    /// on the same level or one up or down. Starts are on levels of the bounds; those at which the box does not fit are skipped.
    ///
    /// The box has left once no block can be in its way any more on its level.
    ///
    /// Returns `None` if `is_stopped` holds, which is asked from time to time.
    pub fn escapes(&self, starts: impl IntoIterator<Item = Cell>, is_stopped: &dyn Fn() -> bool) -> Option<bool> {
        if self.size.x * self.size.y <= MAX_LINES {
            by_lines::escapes(self.solid, self.levels, self.size.into(), starts, is_stopped)
        } else {
            by_regions::escapes(self.solid, self.levels, self.size.into(), starts, is_stopped)
        }
    }
}

impl From<BoxSize> for [i32; 3] {
    fn from(size: BoxSize) -> Self {
        [size.x, size.y, size.z]
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use proptest::prelude::*;

    /// Searches by lines and by regions, and asserts that both find the same.
    fn escapes(solid: &[Cell], size: BoxSize, starts: &[Cell]) -> bool {
        let bounds = Bounds::of(solid.iter().copied()).unwrap();
        let levels = [bounds.min.y, bounds.max.y];
        let starts = || starts.iter().copied();
        let by_lines = by_lines::escapes(solid, levels, size.into(), starts(), &|| false);
        let by_regions = by_regions::escapes(solid, levels, size.into(), starts(), &|| false);
        assert_eq!(by_lines, by_regions, "by lines and by regions");
        assert_eq!(FreeSpace::new(solid, &bounds, size).escapes(starts(), &|| false), by_lines);
        by_lines.unwrap()
    }

    /// Applies the rule as written in `docs/rules.md#ways-out`, cell by cell.
    fn escapes_by_flooding(solid: &[Cell], bounds: &Bounds, size: BoxSize, starts: &[Cell]) -> bool {
        let solid: HashSet<Cell> = solid.iter().copied().collect();
        let fits = |a: Cell| {
            (0..size.x).all(|i| (0..size.y).all(|j| (0..size.z).all(|k| !solid.contains(&a.offset(i, j, k)))))
        };
        let mut open: Vec<Cell> = starts.iter().copied().filter(|&s| fits(s)).collect();
        let mut seen: HashSet<Cell> = open.iter().copied().collect();
        while let Some(a) = open.pop() {
            let corners =
                [(a.x, a.z), (a.x + size.x - 1, a.z), (a.x, a.z + size.z - 1), (a.x + size.x - 1, a.z + size.z - 1)];
            if corners.iter().all(|&(x, z)| bounds.is_outside_in_plan(x, z)) {
                return true;
            }
            for side in a.side_neighbours() {
                for dy in -1..=1 {
                    let next = side.offset(0, dy, 0);
                    if next.y >= bounds.min.y && next.y <= bounds.max.y && fits(next) && seen.insert(next) {
                        open.push(next);
                    }
                }
            }
        }
        false
    }

    /// Cells of a box of 14 x 8 x 12, all of them or its shell.
    fn block_of(is_shell: bool) -> Vec<Cell> {
        let is_edge = |c: &Cell| [0, 13].contains(&c.x) || [0, 7].contains(&c.y) || [0, 11].contains(&c.z);
        let xy = (0..14).flat_map(|x| (0..8).map(move |y| (x, y)));
        let all = xy.flat_map(|(x, y)| (0..12).map(move |z| Cell::new(x, y, z)));
        all.filter(|cell| !is_shell || is_edge(cell)).collect()
    }

    /// A build of which some cells are missing, a box, and where it starts.
    fn builds() -> impl Strategy<Value = (Vec<Cell>, BoxSize, Vec<Cell>)> {
        let cell = (0..14i32, 0..8i32, 0..12i32).prop_map(|(x, y, z)| Cell::new(x, y, z));
        let random = prop::collection::vec(cell.clone(), 1..700);
        let solid = any::<(bool, u64, u8)>().prop_map(|(is_shell, mut state, kept)| {
            let mut is_kept = |_: &Cell| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8 <= kept
            };
            block_of(is_shell).into_iter().filter(|cell| is_kept(cell)).collect::<Vec<_>>()
        });
        let size = (1..5i32, 1..5i32, 1..5i32).prop_map(|(x, y, z)| BoxSize { x, y, z });
        (prop_oneof![random, solid], size, prop::collection::vec(cell, 1..4))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1_000))]
        #[test]
        fn the_box_escapes_where_flooding_escapes((solid, size, starts) in builds()) {
            let Some(bounds) = Bounds::of(solid.iter().copied()) else { return Ok(()) };
            let starts: Vec<Cell> = starts.into_iter().filter(|start| (bounds.min.y..=bounds.max.y).contains(&start.y)).collect();
            let expected = escapes_by_flooding(&solid, &bounds, size, &starts);
            prop_assert_eq!(escapes(&solid, size, &starts), expected);
        }
    }

    #[test]
    fn a_shaft_is_left_by_the_side_alone() {
        // A shaft of one cell, closed at all sides, and the same with a window one level up.
        let walls = block_of(false).into_iter().filter(|cell| (cell.x, cell.z) != (6, 5) || cell.y == 0);
        let closed: Vec<Cell> = walls.collect();
        let windowed: Vec<Cell> =
            closed.iter().copied().filter(|cell| cell.y != 4 || cell.x < 6 || cell.z != 5).collect();
        let size = BoxSize { x: 1, y: 1, z: 1 };
        for (solid, start, gets_out) in
            [(&closed, 2, false), (&windowed, 2, false), (&windowed, 3, true), (&windowed, 4, true)]
        {
            assert_eq!(escapes(solid, size, &[Cell::new(6, start, 5)]), gets_out, "from level {start}");
        }
    }

    #[test]
    fn each_level_of_a_shaft_is_a_place_of_its_own() {
        let size = BoxSize { x: 1, y: 1, z: 1 };
        // The far blocks make the build so wide that it is divided along x and z first, and the shaft stays one region.
        let far = [Cell::new(-100, 0, -100), Cell::new(100, 8, 100)];
        let walls = (0..=8).flat_map(|y| [(5, 5), (7, 5), (6, 4), (6, 6)].map(|(x, z)| Cell::new(x, y, z)));
        let closed: Vec<Cell> = walls.chain([0, 8].map(|y| Cell::new(6, y, 5))).chain(far).collect();
        for window in 1..=7 {
            let solid: Vec<Cell> = closed.iter().copied().filter(|cell| *cell != Cell::new(7, window, 5)).collect();
            for starts in (0..7 * 7 * 7).map(|n| [1 + n % 7, 1 + n / 7 % 7, 1 + n / 49]) {
                let gets_out = escapes(&solid, size, &starts.map(|level| Cell::new(6, level, 5)));
                let is_near = starts.iter().any(|level: &i32| level.abs_diff(window) <= 1);
                assert_eq!(gets_out, is_near, "from levels {starts:?} to a window on level {window}");
            }
        }
    }

    #[test]
    fn stairs_lead_out_along_each_axis() {
        // Two cells wide, with treads of two cells; whatever is missing on the way closes them.
        let step = |along: i32| (13 - along) / 2;
        let along_x: fn(i32, i32) -> (i32, i32) = |along, across| (along, across);
        let along_z = |along: i32, across: i32| (across, along);
        let back_x = |along: i32, across: i32| (13 - along, across);
        let back_z = |along: i32, across: i32| (across, 11 - along);
        for place in [along_x, along_z, back_x, back_z] {
            for missing in [None, Some(6)] {
                let is_open = |along: &i32| missing != Some(*along);
                let carved = (0..11).filter(is_open).flat_map(|along| [5, 6].map(|across| (along, across)));
                let carved: HashSet<(i32, i32, i32)> = carved
                    .map(|(along, across)| {
                        let (x, z) = place(along, across);
                        (x, step(along), z)
                    })
                    .collect();
                let mut solid = block_of(false);
                solid.retain(|cell| !carved.contains(&(cell.x, cell.y, cell.z)));
                let (x, z) = place(10, 5);
                let gets_out = escapes(&solid, BoxSize { x: 1, y: 1, z: 1 }, &[Cell::new(x, step(10), z)]);
                assert_eq!(gets_out, missing.is_none(), "from {x} {z} without {missing:?}");
            }
        }
    }

    #[test]
    fn a_hall_costs_by_its_blocks() {
        // 2,402 blocks, 15 cells apart, close a hall of 300 x 300 x 300: 90,000 lines, each of which was looked at before.
        let steps = || (0..=300).step_by(15);
        let pairs = || steps().flat_map(|a| steps().map(move |b| (a, b)));
        let walls = |(a, b)| {
            [
                Cell::new(a, 0, b),
                Cell::new(a, 300, b),
                Cell::new(0, a, b),
                Cell::new(300, a, b),
                Cell::new(a, b, 0),
                Cell::new(a, b, 300),
            ]
        };
        let solid: Vec<Cell> = pairs().flat_map(walls).collect();
        let bounds = Bounds::of(solid.iter().copied()).unwrap();
        let looks = std::cell::Cell::new(0);
        let look = || {
            looks.set(looks.get() + 1);
            false
        };
        let size = BoxSize { x: 16, y: 16, z: 15 };
        assert_eq!(FreeSpace::new(&solid, &bounds, size).escapes([bounds.centre()], &look), Some(false));
        assert!(looks.get() <= 2, "{} looks, one in 100,000 nodes or obstacles", looks.get());
    }

    #[test]
    fn blocks_thirty_million_apart_cost_nothing() {
        let solid = [Cell::new(-30_000_000, 0, -30_000_000), Cell::new(30_000_000, 5, 30_000_000)];
        let bounds = Bounds::of(solid).unwrap();
        assert!(escapes(&solid, BoxSize { x: 2, y: 2, z: 1 }, &[bounds.centre()]));
    }

    #[test]
    fn a_search_can_be_stopped() {
        let solid = [Cell::new(0, 0, 0), Cell::new(0, 0, 9)];
        for size in [1, 16] {
            let space = FreeSpace::new(&solid, &Bounds::of(solid).unwrap(), BoxSize { x: size, y: size, z: 1 });
            assert_eq!(space.escapes([Cell::new(0, 0, 5)], &|| true), None);
        }
    }
}
