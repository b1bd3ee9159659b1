//! Movement of a box through free space, for the published exit rule: can the box leave a build?
//!
//! The anchor of the box is its corner of least x, y and z. The plane of x and y is divided into regions in which the same
//! blocks are in the way ([`Regions`]); along z, the free anchors of a region form runs between obstacles. The search goes
//! from run to run: its cost depends on the blocks, not on the volume.

use std::collections::HashSet;

use super::cell::{Bounds, Cell};
use super::regions::{Area, Blocked, Regions, Span};

/// Number of runs that are followed between two polls of the stop signal.
const RUNS_PER_LOOK: usize = 100;

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
    size: BoxSize,
    levels: [i32; 2],
}

/// A run of free anchors: the number of the region, the number of the run in the region, and the level if it is a shaft.
type Run = (u32, usize, Option<i32>);

struct Search<'a> {
    regions: Regions,
    is_stopped: &'a dyn Fn() -> bool,
    seen: HashSet<Run, foldhash::fast::RandomState>,
    open: Vec<Run>,
    /// The regions of one step, kept for its memory.
    beside: Vec<u32>,
}

impl<'a> FreeSpace<'a> {
    /// Describes the space that `solid` leaves to a box of `size`, whose anchor stays within the heights of `bounds`.
    #[must_use]
    pub const fn new(solid: &'a [Cell], bounds: &Bounds, size: BoxSize) -> Self {
        Self { solid, size, levels: [bounds.min.y, bounds.max.y] }
    }

    /// Returns whether a box whose anchor starts at one of `starts` can leave. Each step goes to one of the four sides,
    /// on the same level or one up or down. Starts at which the box does not fit are skipped.
    ///
    /// The box has left once it reaches a run without an obstacle at one end: along that run it can move without limit.
    ///
    /// Returns `None` if `is_stopped` holds, which is asked from time to time.
    pub fn escapes(&self, starts: impl IntoIterator<Item = Cell>, is_stopped: &dyn Fn() -> bool) -> Option<bool> {
        let mut search = Search {
            regions: Regions::new(self.solid, self.levels, [self.size.x, self.size.y, self.size.z]),
            is_stopped,
            seen: HashSet::default(),
            open: Vec::new(),
            beside: Vec::new(),
        };
        for (number, start) in starts.into_iter().enumerate() {
            if number.is_multiple_of(RUNS_PER_LOOK) && is_stopped() {
                return None;
            }
            let place = [start.x, start.y];
            if search.visit(Area { min: place, max: place }, (start.z, start.z)) {
                return Some(true);
            }
        }
        search.gets_out()
    }
}

impl Search<'_> {
    /// Follows the queued runs. Returns true once one is unbounded.
    fn gets_out(&mut self) -> Option<bool> {
        let mut followed: usize = 0;
        while let Some(run) = self.open.pop() {
            if followed.is_multiple_of(RUNS_PER_LOOK) && (self.is_stopped)() {
                return None;
            }
            followed += 1;
            if self.steps_out(run) {
                return Some(true);
            }
        }
        Some(false)
    }

    /// Queues what one step from a run reaches. Returns true if a run among that is unbounded.
    ///
    /// From a single cell, a step goes to one of its four sides, one level up, down or neither. From more cells side by side,
    /// it also reaches what lies above and below of them.
    fn steps_out(&mut self, (region, number, level): Run) -> bool {
        let region = self.regions.region(region);
        let (from, to) = free_run(&region.blocked, number).expect("an unbounded run ends the search");
        let ([west, bottom], [east, top]) = (region.area.min, region.area.max);
        let (bottom, top) = level.map_or((bottom - 1, top + 1), |level| (level - 1, level + 1));
        let area = |west, east| Area { min: [west, bottom], max: [east, top] };
        if level.is_some() {
            self.visit(area(west - 1, west - 1), (from, from))
                || self.visit(area(east + 1, east + 1), (from, from))
                || self.visit(area(west, east), (from - 1, from - 1))
                || self.visit(area(west, east), (to + 1, to + 1))
        } else {
            self.visit(area(west - 1, east + 1), (from, to)) || self.visit(area(west, east), (from - 1, to + 1))
        }
    }

    /// Queues the unseen runs that have a cell in an area and in a span of z. Returns true if one is unbounded.
    fn visit(&mut self, area: Area, span: Span) -> bool {
        let all = self.regions.area();
        let area =
            Area { min: [area.min[0], area.min[1].max(all.min[1])], max: [area.max[0], area.max[1].min(all.max[1])] };
        if area.min[1] > area.max[1] {
            return false;
        }
        if area.min[0] < all.min[0] || area.max[0] > all.max[0] {
            return true;
        }
        let mut beside = std::mem::take(&mut self.beside);
        self.regions.find(&area, &mut beside);
        let gets_out = beside.drain(..).any(|region| self.visit_region(region, &area, span));
        self.beside = beside;
        gets_out
    }

    /// Does for one region that meets the area what [`Self::visit`] does.
    fn visit_region(&mut self, number_of_region: u32, area: &Area, (from, to): Span) -> bool {
        let region = self.regions.region(number_of_region);
        let blocked = &region.blocked;
        let is_narrow = region.area.min[0] == region.area.max[0];
        let (bottom, top) = (region.area.min[1].max(area.min[1]), region.area.max[1].min(area.max[1]));
        // Run k lies between obstacle k - 1 and obstacle k.
        let first = blocked.partition_point(|&(_, end)| end < from);
        for number in first..=blocked.len() {
            let begins = number.checked_sub(1).map_or(i32::MIN, |before| blocked[before].1 + 1);
            let ends = blocked.get(number).map_or(i32::MAX, |&(start, _)| start - 1);
            if begins > to {
                break;
            }
            if ends < from {
                continue;
            }
            if number == 0 || number == blocked.len() {
                return true;
            }
            // In a shaft, a single cell on each level, no step leads straight up or down.
            let is_shaft = is_narrow && begins == ends;
            let levels = if is_shaft { bottom..=top } else { bottom..=bottom };
            for level in levels {
                let run = (number_of_region, number, is_shaft.then_some(level));
                if self.seen.insert(run) {
                    self.open.push(run);
                }
            }
        }
        false
    }
}

/// Returns the closed interval of a run that has an obstacle at both ends.
fn free_run(blocked: &Blocked, number: usize) -> Option<Span> {
    Some((blocked.get(number.checked_sub(1)?)?.1 + 1, blocked.get(number)?.0 - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
        fn runs_escape_where_flooding_escapes((solid, size, starts) in builds()) {
            let Some(bounds) = Bounds::of(solid.iter().copied()) else { return Ok(()) };
            let starts: Vec<Cell> = starts.into_iter().filter(|start| (bounds.min.y..=bounds.max.y).contains(&start.y)).collect();
            let expected = escapes_by_flooding(&solid, &bounds, size, &starts);
            prop_assert_eq!(FreeSpace::new(&solid, &bounds, size).escapes(starts, &|| false), Some(expected));
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
            let space = FreeSpace::new(solid, &Bounds::of(solid.iter().copied()).unwrap(), size);
            assert_eq!(space.escapes([Cell::new(6, start, 5)], &|| false), Some(gets_out), "from level {start}");
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
                let bounds = Bounds::of(solid.iter().copied()).unwrap();
                let (x, z) = place(10, 5);
                let space = FreeSpace::new(&solid, &bounds, BoxSize { x: 1, y: 1, z: 1 });
                let gets_out = space.escapes([Cell::new(x, step(10), z)], &|| false);
                assert_eq!(gets_out, Some(missing.is_none()), "from {x} {z} without {missing:?}");
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
        assert!(looks.get() <= 2_402 * 2 / RUNS_PER_LOOK, "{} looks", looks.get());
    }

    #[test]
    fn blocks_thirty_million_apart_cost_nothing() {
        let solid = [Cell::new(-30_000_000, 0, -30_000_000), Cell::new(30_000_000, 5, 30_000_000)];
        let bounds = Bounds::of(solid).unwrap();
        let space = FreeSpace::new(&solid, &bounds, BoxSize { x: 2, y: 2, z: 1 });
        assert_eq!(space.escapes([bounds.centre()], &|| false), Some(true));
    }

    #[test]
    fn a_search_can_be_stopped() {
        let solid = [Cell::new(0, 0, 0), Cell::new(0, 0, 9)];
        let space = FreeSpace::new(&solid, &Bounds::of(solid).unwrap(), BoxSize { x: 1, y: 1, z: 1 });
        assert_eq!(space.escapes([Cell::new(0, 0, 5)], &|| true), None);
    }
}
