//! The search for small boxes: from one run of free anchors to the next.
//!
//! On each line of fixed x and y, the free anchors form runs along z between obstacles.

use std::collections::{HashMap, HashSet};

use crate::voxel::cell::Cell;

/// Number of lines that are computed between two polls of the stop signal.
const LINES_PER_LOOK: usize = 1_000;

/// The anchors on one line at which the box does not fit: sorted, disjoint closed intervals along z.
type Blocked = Vec<(i32, i32)>;

/// What is known of each line `(x, y)`.
type Lines<T> = HashMap<(i32, i32), T, foldhash::fast::RandomState>;

/// A search. It computes where the box fits only on the lines that it reaches.
struct Search<'a> {
    /// The z of the solid cells on each line.
    solid: Lines<Vec<i32>>,
    /// Size of the box along x, y and z.
    size: [i32; 3],
    levels: [i32; 2],
    is_stopped: &'a dyn Fn() -> bool,
    /// Where a box with the height of one cell does not fit, from which follows where the whole box does not.
    flat: Lines<Blocked>,
    blocked: Lines<Blocked>,
    seen: HashSet<Run, foldhash::fast::RandomState>,
    open: Vec<Run>,
}

/// A run of free anchors: the line `(x, y)`, and the number of the run on that line.
type Run = (i32, i32, usize);

/// Does what [`super::FreeSpace::escapes`] does.
pub(super) fn escapes(
    solid: &[Cell],
    levels: [i32; 2],
    size: [i32; 3],
    starts: impl IntoIterator<Item = Cell>,
    is_stopped: &dyn Fn() -> bool,
) -> Option<bool> {
    let mut lines: Lines<Vec<i32>> = HashMap::default();
    for cell in solid {
        lines.entry((cell.x, cell.y)).or_default().push(cell.z);
    }
    let mut search = Search {
        solid: lines,
        size,
        levels,
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
                if level < self.levels[0] || level > self.levels[1] {
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
        let [width, height, depth] = self.size;
        let mut blocked = Blocked::new();
        for level in y..y + height {
            let flat = self.flat.entry((x, level)).or_insert_with(|| {
                let cells = (x..x + width).filter_map(|x| self.solid.get(&(x, level))).flatten();
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
