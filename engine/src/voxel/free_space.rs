//! Movement of a box through free space, for the published exit rule: can the box leave a build?
//!
//! The anchor of the box is its corner of least x, y and z. On each line of fixed x and y, the free anchors form runs
//! along z between obstacles. The search goes from run to run: its cost depends on the blocks, not on the volume.

use std::collections::{HashMap, HashSet};

use super::cell::{Bounds, Cell};

/// Number of lines that are computed between two polls of the stop signal.
const LINES_PER_LOOK: usize = 1_000;

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

/// The anchors on one line at which the box does not fit: sorted, disjoint closed intervals along z.
type Blocked = Vec<(i32, i32)>;

/// What is known of each line `(x, y)`.
type Lines<T> = HashMap<(i32, i32), T, foldhash::fast::RandomState>;

/// The free space of a moving box among solid cells.
#[derive(Debug)]
pub struct FreeSpace {
    /// The z of the solid cells on each line.
    solid: Lines<Vec<i32>>,
    size: BoxSize,
    min_y: i32,
    max_y: i32,
}

/// A search. It computes where the box fits only on the lines that it reaches: a large box has hundreds of lines for each
/// cell.
struct Search<'a> {
    space: &'a FreeSpace,
    is_stopped: &'a dyn Fn() -> bool,
    /// Where a box with the height of one cell does not fit, from which follows where the whole box does not.
    flat: Lines<Blocked>,
    blocked: Lines<Blocked>,
    seen: HashSet<Run, foldhash::fast::RandomState>,
    open: Vec<Run>,
}

/// A run of free anchors: the line `(x, y)`, and the number of the run on that line.
type Run = (i32, i32, usize);

impl FreeSpace {
    /// Describes the space that `solid` leaves to a box of `size`, whose anchor stays within the heights of `bounds`.
    #[must_use]
    pub fn new(solid: &[Cell], bounds: &Bounds, size: BoxSize) -> Self {
        let mut lines: Lines<Vec<i32>> = HashMap::default();
        for cell in solid {
            lines.entry((cell.x, cell.y)).or_default().push(cell.z);
        }
        Self { solid: lines, size, min_y: bounds.min.y, max_y: bounds.max.y }
    }

    /// Returns whether a box whose anchor starts at one of `starts` can leave. Each step goes to one of the four sides,
    /// on the same level or one up or down. Starts at which the box does not fit are skipped.
    ///
    /// The box has left once it reaches a run without an obstacle at one end: along that run it can move without limit.
    ///
    /// Returns `None` if `is_stopped` holds, which is asked from time to time.
    pub fn escapes(&self, starts: impl IntoIterator<Item = Cell>, is_stopped: &dyn Fn() -> bool) -> Option<bool> {
        let mut search = Search {
            space: self,
            is_stopped,
            flat: HashMap::default(),
            blocked: HashMap::default(),
            seen: HashSet::default(),
            open: Vec::new(),
        };
        for start in starts {
            if search.visit((start.x, start.y), (start.z, start.z))? {
                return Some(true);
            }
        }
        search.gets_out()
    }
}

/// Sorts intervals, and joins those that overlap or touch.
fn joined(mut blocked: Blocked) -> Blocked {
    blocked.sort_unstable();
    blocked.dedup_by(|next, last| {
        let joins = next.0 <= last.1 + 1;
        if joins {
            last.1 = last.1.max(next.1);
        }
        joins
    });
    blocked.shrink_to_fit();
    blocked
}

impl Search<'_> {
    /// Follows the queued runs. Returns true once one is unbounded.
    fn gets_out(&mut self) -> Option<bool> {
        while let Some((x, y, number)) = self.open.pop() {
            let Some((from, to)) = self.blocked.get(&(x, y)).and_then(|line| free_run(line, number)) else {
                return Some(true);
            };
            for dy in -1..=1 {
                let level = y + dy;
                if level < self.space.min_y || level > self.space.max_y {
                    continue;
                }
                let beside: &[(i32, i32)] = match (dy, from == to) {
                    (0, _) => &[],
                    (_, true) => &[(from - 1, from - 1), (from + 1, from + 1)],
                    (_, false) => &[(from - 1, to + 1)],
                };
                let above_or_below = beside.iter().map(|span| (x, *span));
                for (x, span) in above_or_below.chain([x - 1, x + 1].map(|side| (side, (from, to)))) {
                    if self.visit((x, level), span)? {
                        return Some(true);
                    }
                }
            }
        }
        Some(false)
    }

    /// Computes where the box does not fit on a line.
    fn find_blocked(&mut self, (x, y): (i32, i32)) -> Option<()> {
        if self.blocked.len().is_multiple_of(LINES_PER_LOOK) && (self.is_stopped)() {
            return None;
        }
        let BoxSize { x: width, y: height, z: depth } = self.space.size;
        let mut blocked = Blocked::new();
        for level in y..y + height {
            let flat = self.flat.entry((x, level)).or_insert_with(|| {
                let cells = (x..x + width).filter_map(|x| self.space.solid.get(&(x, level))).flatten();
                joined(cells.map(|z| (z - depth + 1, *z)).collect())
            });
            blocked.extend_from_slice(flat);
        }
        self.blocked.insert((x, y), joined(blocked));
        Some(())
    }

    /// Queues the unseen runs of a line that meet the closed interval `(from, to)`. Returns true if one is unbounded.
    fn visit(&mut self, line: (i32, i32), (from, to): (i32, i32)) -> Option<bool> {
        if !self.blocked.contains_key(&line) {
            self.find_blocked(line)?;
        }
        let blocked = &self.blocked[&line];
        // Run k lies between obstacle k - 1 and obstacle k.
        let first = blocked.partition_point(|&(_, end)| end < from);
        for number in first..=blocked.len() {
            let begins = if number == 0 { i32::MIN } else { blocked[number - 1].1 + 1 };
            if begins > to {
                break;
            }
            let ends = blocked.get(number).map_or(i32::MAX, |&(start, _)| start - 1);
            if ends < from || begins > ends {
                continue;
            }
            if number == 0 || number == blocked.len() {
                return Some(true);
            }
            if self.seen.insert((line.0, line.1, number)) {
                self.open.push((line.0, line.1, number));
            }
        }
        Some(false)
    }
}

fn free_run(blocked: &Blocked, number: usize) -> Option<(i32, i32)> {
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

    proptest! {
        #[test]
        fn runs_escape_where_flooding_escapes(
            cells in prop::collection::vec((0..6i32, 0..4i32, 0..6i32), 30..110),
            size in (1..3i32, 1..3i32, 1..3i32),
            start in (1..5i32, 0..4i32, 1..5i32),
        ) {
            let solid: Vec<Cell> = cells.into_iter().map(|(x, y, z)| Cell::new(x, y, z)).collect();
            let bounds = Bounds { min: Cell::new(0, 0, 0), max: Cell::new(5, 3, 5) };
            let size = BoxSize { x: size.0, y: size.1, z: size.2 };
            let starts = [Cell::new(start.0, start.1, start.2)];
            let expected = escapes_by_flooding(&solid, &bounds, size, &starts);
            prop_assert_eq!(FreeSpace::new(&solid, &bounds, size).escapes(starts, &|| false), Some(expected));
        }
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
