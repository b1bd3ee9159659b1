//! Movement of a box through free space, for the published exit rule: can the box leave a build?
//!
//! The anchor of the box is its corner of least x, y and z. On each line of fixed x and y, the free anchors form runs
//! along z between obstacles. The search goes from run to run: its cost depends on the blocks, not on the volume.

use std::collections::{HashMap, HashSet};

use super::cell::{Bounds, Cell};

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

/// The free space of a moving box among solid cells.
#[derive(Debug)]
pub struct FreeSpace {
    lines: HashMap<(i32, i32), Blocked, foldhash::fast::RandomState>,
    min_y: i32,
    max_y: i32,
}

/// A run of free anchors: the line `(x, y)`, and the number of the run on that line.
type Run = (i32, i32, usize);

impl FreeSpace {
    /// Computes the space that `solid` leaves to a box of `size`, whose anchor stays within the heights of `bounds`.
    #[must_use]
    pub fn new(solid: &[Cell], bounds: &Bounds, size: BoxSize) -> Self {
        let mut lines: HashMap<(i32, i32), Blocked, _> = HashMap::default();
        for cell in solid {
            for x in cell.x - size.x + 1..=cell.x {
                for y in (cell.y - size.y + 1).max(bounds.min.y)..=cell.y {
                    lines.entry((x, y)).or_default().push((cell.z - size.z + 1, cell.z));
                }
            }
        }
        #[expect(clippy::iter_over_hash_type, reason = "each line is sorted independently")]
        for blocked in lines.values_mut() {
            blocked.sort_unstable();
            blocked.dedup_by(|next, last| {
                let joins = next.0 <= last.1 + 1;
                if joins {
                    last.1 = last.1.max(next.1);
                }
                joins
            });
        }
        Self { lines, min_y: bounds.min.y, max_y: bounds.max.y }
    }

    /// Returns whether a box whose anchor starts at one of `starts` can leave. Each step goes to one of the four sides,
    /// on the same level or one up or down. Starts at which the box does not fit are skipped.
    ///
    /// The box has left once it reaches a run without an obstacle at one end: along that run it can move without limit.
    #[must_use]
    pub fn escapes(&self, starts: impl IntoIterator<Item = Cell>) -> bool {
        let mut seen: HashSet<Run, foldhash::fast::RandomState> = HashSet::default();
        let mut open: Vec<Run> = Vec::new();
        for start in starts {
            if self.visit((start.x, start.y), (start.z, start.z), &mut seen, &mut open) {
                return true;
            }
        }
        while let Some((x, y, number)) = open.pop() {
            let Some(&(from, to)) = self.lines.get(&(x, y)).and_then(|line| free_run(line, number)).as_ref() else {
                return true;
            };
            for dy in -1..=1 {
                let level = y + dy;
                if level < self.min_y || level > self.max_y {
                    continue;
                }
                let beside: &[(i32, i32)] = match (dy, from == to) {
                    (0, _) => &[],
                    (_, true) => &[(from - 1, from - 1), (from + 1, from + 1)],
                    (_, false) => &[(from - 1, to + 1)],
                };
                for &span in beside {
                    if self.visit((x, level), span, &mut seen, &mut open) {
                        return true;
                    }
                }
                for side in [x - 1, x + 1] {
                    if self.visit((side, level), (from, to), &mut seen, &mut open) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Queues the unseen runs of a line that meet the closed interval `(from, to)`. Returns true if one is unbounded.
    fn visit(
        &self,
        (x, y): (i32, i32),
        (from, to): (i32, i32),
        seen: &mut HashSet<Run, foldhash::fast::RandomState>,
        open: &mut Vec<Run>,
    ) -> bool {
        let Some(blocked) = self.lines.get(&(x, y)) else { return true };
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
                return true;
            }
            if seen.insert((x, y, number)) {
                open.push((x, y, number));
            }
        }
        false
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
            prop_assert_eq!(FreeSpace::new(&solid, &bounds, size).escapes(starts), expected);
        }
    }

    #[test]
    fn blocks_thirty_million_apart_cost_nothing() {
        let solid = [Cell::new(-30_000_000, 0, -30_000_000), Cell::new(30_000_000, 5, 30_000_000)];
        let bounds = Bounds::of(solid).unwrap();
        let space = FreeSpace::new(&solid, &bounds, BoxSize { x: 2, y: 2, z: 1 });
        assert!(space.escapes([bounds.centre()]));
    }
}
