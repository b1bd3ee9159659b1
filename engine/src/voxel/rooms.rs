//! Rooms of one level: regions of air that the outside cannot reach through sides or corners.
//!
//! Air is stored as runs between the walls of each row, so the cost depends on the walls, not on the enclosed area.

use std::collections::HashSet;

use super::planar::{DisjointSets, PlaneCell};

/// A run of free cells in row `x`, from `from` to `to` (inclusive) along z, with a wall at each end.
#[derive(Debug, Clone, Copy)]
struct Run {
    x: i32,
    from: i32,
    to: i32,
}

/// One enclosed region of air.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// First cell of the room, by x, then z.
    pub first: PlaneCell,
    /// Number of free cells in the room.
    pub area: u64,
}

/// The walls of one level and the rooms that they enclose.
#[derive(Debug)]
pub struct FloorPlan {
    walls: Vec<PlaneCell>,
    runs: Vec<Run>,
    /// Whether the outside reaches each run through sides and corners.
    is_outside: Vec<bool>,
    rooms: Vec<Room>,
}

impl FloorPlan {
    /// Computes the plan of `walls`, which must be sorted and distinct.
    #[must_use]
    pub fn of(walls: Vec<PlaneCell>) -> Self {
        let runs = runs_between(&walls);
        let (is_outside, rooms) = enclosed(&walls, &runs, 1);
        Self { walls, runs, is_outside, rooms }
    }

    /// Returns the rooms, in the order of their first cells.
    #[must_use]
    pub fn rooms(&self) -> &[Room] {
        &self.rooms
    }

    /// Finds up to `limit` leaks: free cells at each of which an additional wall would enclose another room.
    ///
    /// Considers gaps one cell wide between two walls, and corners that air passes diagonally.
    #[must_use]
    pub fn leaks(&self, limit: usize) -> Vec<PlaneCell> {
        if self.walls.len() > Self::MAX_WALLS_FOR_LEAKS {
            return Vec::new();
        }
        let mut candidates = self.leak_candidates();
        candidates.truncate(Self::MAX_LEAK_CANDIDATES);
        let mut leaks = Vec::new();
        for cell in candidates {
            let mut walls = self.walls.clone();
            let at = walls.partition_point(|wall| *wall < cell);
            walls.insert(at, cell);
            if Self::of(walls).rooms.len() > self.rooms.len() {
                leaks.push(cell);
            }
            if leaks.len() == limit {
                break;
            }
        }
        leaks
    }

    /// Limit on candidates, each of which costs a whole plan: leaks are only evidence, not the verdict.
    const MAX_LEAK_CANDIDATES: usize = 64;
    const MAX_WALLS_FOR_LEAKS: usize = 4_096;

    fn leak_candidates(&self) -> Vec<PlaneCell> {
        let walls: HashSet<PlaneCell, foldhash::fast::RandomState> = self.walls.iter().copied().collect();
        let (outside_by_sides, _) = enclosed(&self.walls, &self.runs, 0);
        let mut leaks: Vec<PlaneCell> = Vec::new();
        for (run, outside) in self.runs.iter().zip(&self.is_outside) {
            if *outside && run.from == run.to {
                leaks.push((run.x, run.from));
            }
        }
        for &(x, z) in &self.walls {
            let gap = (x + 1, z);
            if walls.contains(&(x + 2, z)) && !walls.contains(&gap) && self.reaches(gap, &self.is_outside) {
                leaks.push(gap);
            }
            for dz in [-1, 1] {
                let (a, b) = ((x + 1, z), (x, z + dz));
                let slips = walls.contains(&(x + 1, z + dz)) && !walls.contains(&a) && !walls.contains(&b);
                if slips && self.reaches(a, &self.is_outside) {
                    match (self.reaches(a, &outside_by_sides), self.reaches(b, &outside_by_sides)) {
                        (true, false) => leaks.push(a),
                        (false, true) => leaks.push(b),
                        _ => {}
                    }
                }
            }
        }
        leaks.sort_unstable();
        leaks.dedup();
        leaks
    }

    /// Returns whether the free cell belongs to the outside, given whether each run does.
    fn reaches(&self, (x, z): PlaneCell, is_outside: &[bool]) -> bool {
        let i = self.runs.partition_point(|run| (run.x, run.to) < (x, z));
        match self.runs.get(i) {
            Some(run) if run.x == x && run.from <= z => is_outside[i],
            _ => true,
        }
    }
}

fn runs_between(walls: &[PlaneCell]) -> Vec<Run> {
    let pairs = walls.iter().zip(walls.iter().skip(1));
    pairs
        .filter(|((x, z), (next_x, next_z))| x == next_x && next_z - z > 1)
        .map(|((x, z), (_, next_z))| Run { x: *x, from: z + 1, to: next_z - 1 })
        .collect()
}

/// Joins runs of neighbouring rows that touch within `reach` cells past their ends (1: corners count, 0: they do not),
/// and joins open runs with the outside. Returns whether each run is outside, and the rooms.
fn enclosed(walls: &[PlaneCell], runs: &[Run], reach: i32) -> (Vec<bool>, Vec<Room>) {
    let outside = runs.len();
    let mut sets = DisjointSets::new(runs.len() + 1);
    for (i, run) in runs.iter().enumerate() {
        for x in [run.x - 1, run.x + 1] {
            let row_start = walls.partition_point(|wall| *wall < (x, i32::MIN));
            let row_end = walls.partition_point(|wall| *wall <= (x, i32::MAX));
            let row = &walls[row_start..row_end];
            let open = match (row.first(), row.last()) {
                (Some(&(_, first)), Some(&(_, last))) => run.from - reach < first || run.to + reach > last,
                _ => true,
            };
            if open {
                sets.join(i, outside);
            }
        }
        let next = runs.partition_point(|other| (other.x, other.to) < (run.x + 1, run.from - reach));
        let touching = runs[next..].iter().take_while(|o| o.x == run.x + 1 && o.from <= run.to + reach);
        for (k, _) in touching.enumerate() {
            sets.join(i, next + k);
        }
    }
    let outside_root = sets.root(outside);
    let is_outside: Vec<bool> = (0..runs.len()).map(|i| sets.root(i) == outside_root).collect();
    let mut room_of_root = vec![None; runs.len() + 1];
    let mut rooms: Vec<Room> = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        if is_outside[i] {
            continue;
        }
        let number = *room_of_root[sets.root(i)].get_or_insert_with(|| {
            rooms.push(Room { first: (run.x, run.from), area: 0 });
            rooms.len() - 1
        });
        rooms[number].area += u64::from(run.to.abs_diff(run.from)) + 1;
    }
    (is_outside, rooms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::planar::sorted_distinct;
    use proptest::prelude::*;

    fn plan(rows: &[&str]) -> FloorPlan {
        let mut walls = Vec::new();
        for (x, row) in (0..).zip(rows) {
            for (z, c) in (0..).zip(row.chars()) {
                if c == '#' {
                    walls.push((x, z));
                }
            }
        }
        FloorPlan::of(walls)
    }

    #[test]
    fn a_closed_ring_is_a_room_and_a_missing_corner_leaks() {
        assert_eq!(plan(&["###", "#.#", "###"]).rooms(), [Room { first: (1, 1), area: 1 }]);
        let leaky = plan(&[".##", "#.#", "###"]);
        assert!(leaky.rooms().is_empty());
        assert_eq!(leaky.leaks(20), [(0, 0)]);
    }

    #[test]
    fn a_gap_of_one_cell_is_named() {
        assert_eq!(plan(&["####", "#..#", "#...", "####"]).leaks(20), [(2, 3)]);
        assert_eq!(plan(&["#####", "#...#", "##.##"]).leaks(20), [(2, 2)]);
    }

    #[test]
    fn a_room_of_a_million_cells_costs_its_walls_only() {
        let mut walls = Vec::new();
        for i in 0..=30_000_000 / 100 {
            walls.extend([(0, i), (1000, i)]);
        }
        for x in 0..=1000 {
            walls.extend([(x, 0), (x, 300_000)]);
        }
        let plan = FloorPlan::of(sorted_distinct(walls));
        assert_eq!(plan.rooms().len(), 1);
        assert_eq!(plan.rooms()[0].area, 999 * 299_999);
    }

    /// Applies the rule as written in `docs/rules.md#shape`, cell by cell.
    fn rooms_by_flooding(walls: &[PlaneCell]) -> usize {
        let (lo, hi) = (-1, 8);
        let mut seen: HashSet<PlaneCell> = walls.iter().copied().collect();
        let mut components = 0usize;
        let mut order = vec![(lo, lo)];
        order.extend((lo..=hi).flat_map(|x| (lo..=hi).map(move |z| (x, z))));
        for start in order {
            if !seen.insert(start) {
                continue;
            }
            components += 1;
            let mut stack = vec![start];
            while let Some((x, z)) = stack.pop() {
                for (dx, dz) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| (dx, dz))) {
                    let next = (x + dx, z + dz);
                    if (lo..=hi).contains(&next.0) && (lo..=hi).contains(&next.1) && seen.insert(next) {
                        stack.push(next);
                    }
                }
            }
        }
        components - 1
    }

    proptest! {
        #[test]
        fn runs_find_the_rooms_that_flooding_finds(walls in prop::collection::vec((0..8i32, 0..8i32), 0..50)) {
            let walls = sorted_distinct(walls);
            let expected = rooms_by_flooding(&walls);
            prop_assert_eq!(FloorPlan::of(walls).rooms().len(), expected);
        }
    }
}
