//! The air of a grid in runs along z, and the regions that they form.

use std::ops::Range;

use super::planar::DisjointSets;

/// The runs of air of a grid whose cells lie in memory by height, then x, then z.
#[derive(Debug)]
pub(super) struct AirRuns {
    size: [usize; 3],
    /// The runs as ranges of cell indices, in order. None crosses from one row into the next.
    runs: Vec<Range<usize>>,
    /// For each row, the index of its first run; and the number of runs at the end.
    first_of_row: Vec<usize>,
}

impl AirRuns {
    /// Finds the runs of a grid of `size` cells along x, y and z. `is_free` tells which rows are air throughout, and
    /// `is_air` which cell indices of the others are.
    pub(super) fn of(size: [i32; 3], is_free: impl Fn(usize) -> bool, is_air: impl Fn(usize) -> bool) -> Self {
        let size = size.map(|cells| cells as usize);
        let [x, y, z] = size;
        let mut first_of_row = Vec::with_capacity(x * y + 1);
        let mut runs = Vec::with_capacity(x * y);
        for row in 0..x * y {
            first_of_row.push(runs.len());
            let (mut at, end) = (row * z, (row + 1) * z);
            if is_free(row) {
                runs.push(at..end);
                continue;
            }
            while at < end {
                let start = at;
                while at < end && is_air(at) {
                    at += 1;
                }
                if at > start {
                    runs.push(start..at);
                }
                at += 1;
            }
        }
        first_of_row.push(runs.len());
        Self { size, runs, first_of_row }
    }

    /// Returns all runs, in the order of their cells.
    pub(super) fn all(&self) -> &[Range<usize>] {
        &self.runs
    }

    /// Returns the run that a cell belongs to; none if the cell is not air.
    pub(super) fn at(&self, cell: usize) -> Option<usize> {
        let own = self.of_row(cell / self.size[2]);
        let before = self.runs[own.clone()].partition_point(|run| run.end <= cell);
        let run = own.start + before;
        (run < own.end && self.runs[run].start <= cell).then_some(run)
    }

    /// Returns for each run the number of its region, from 0, in the order of the regions' first cells.
    pub(super) fn regions(&self) -> Vec<u32> {
        let mut sets = DisjointSets::new(self.runs.len());
        let sx = self.size[0];
        for row in 0..self.first_of_row.len() - 1 {
            // Air passes through faces and, within a level, past vertical edges: a room needs its corners.
            if row % sx > 0 {
                self.join_rows(row, row - 1, 1, &mut sets);
            }
            if row >= sx {
                self.join_rows(row, row - sx, 0, &mut sets);
            }
        }
        sets.numbers().0
    }

    /// Joins the runs of two rows that overlap, or come as close to it as `reach`.
    fn join_rows(&self, row: usize, other: usize, reach: usize, sets: &mut DisjointSets) {
        let (one, two) = (self.of_row(row), self.of_row(other));
        let (mut i, mut j) = (one.start, two.start);
        let ahead = (row - other) * self.size[2];
        while i < one.end && j < two.end {
            let (own, beside) = (&self.runs[i], &self.runs[j]);
            let beside = beside.start + ahead..beside.end + ahead;
            if own.start < beside.end + reach && beside.start < own.end + reach {
                sets.join(i, j);
            }
            // What follows the run that ends first is apart from it, so it touches nothing more of the other row.
            if own.end < beside.end { i += 1 } else { j += 1 }
        }
    }

    fn of_row(&self, row: usize) -> Range<usize> {
        self.first_of_row[row]..self.first_of_row[row + 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: [i32; 3] = [4, 3, 5];

    /// Labels each cell of air with the number of its region, counted from 1, cell by cell.
    fn by_flooding(air: &[bool]) -> Vec<u32> {
        let [sx, sy, sz] = SIZE;
        let at = |[x, y, z]: [i32; 3]| ((y * sx + x) * sz + z) as usize;
        let mut label = vec![0; air.len()];
        let mut regions = 0;
        let cells = (0..sy).flat_map(|y| (0..sx).flat_map(move |x| (0..sz).map(move |z| [x, y, z])));
        for start in cells {
            if !air[at(start)] || label[at(start)] != 0 {
                continue;
            }
            regions += 1;
            label[at(start)] = regions;
            let mut open = vec![start];
            while let Some([x, y, z]) = open.pop() {
                let level = (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| [x + dx, y, z + dz]));
                for next in level.chain([[x, y + 1, z], [x, y - 1, z]]) {
                    let is_inside = next.iter().zip(SIZE).all(|(at, size)| (0..size).contains(at));
                    if is_inside && air[at(next)] && label[at(next)] == 0 {
                        label[at(next)] = regions;
                        open.push(next);
                    }
                }
            }
        }
        label
    }

    proptest! {
        #[test]
        fn runs_form_the_regions_that_flooding_finds(air in prop::collection::vec(prop::bool::weighted(0.4), 60)) {
            let row = SIZE[2] as usize;
            let runs = AirRuns::of(SIZE, |at| air[at * row..(at + 1) * row].iter().all(|air| *air), |cell| air[cell]);
            let region = runs.regions();
            let of_cells: Vec<u32> = (0..air.len()).map(|cell| runs.at(cell).map_or(0, |run| region[run] + 1)).collect();
            prop_assert_eq!(of_cells, by_flooding(&air));
        }
    }
}
