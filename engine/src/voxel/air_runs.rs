//! The air of a grid in runs along z, and the regions that they form. A search from run to run looks at each run once,
//! where one from cell to cell looks at every neighbour of every cell.

use std::ops::Range;

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
    /// Finds the runs of a grid of `size` cells along x, y and z; `is_air` tells which cell indices are air.
    pub(super) fn of(size: [i32; 3], is_air: impl Fn(usize) -> bool) -> Self {
        let size = size.map(|cells| cells as usize);
        let [x, y, z] = size;
        let mut first_of_row = Vec::with_capacity(x * y + 1);
        let mut runs = Vec::new();
        for row in 0..x * y {
            first_of_row.push(runs.len());
            let (mut at, end) = (row * z, (row + 1) * z);
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
    pub(super) fn all(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.runs.iter().cloned()
    }

    /// Visits a run and all that air links to it, each time that it meets them. `visit` returns whether the run is new.
    pub(super) fn fill(&self, start: Range<usize>, mut visit: impl FnMut(Range<usize>) -> bool) {
        if !visit(start.clone()) {
            return;
        }
        let mut open = vec![start];
        while let Some(run) = open.pop() {
            for next in self.beside(&run) {
                if visit(next.clone()) {
                    open.push(next);
                }
            }
        }
    }

    /// Returns the runs that touch this one.
    fn beside(&self, run: &Range<usize>) -> impl Iterator<Item = Range<usize>> + '_ {
        let [sx, sy, sz] = self.size;
        let row = run.start / sz;
        let (x, y) = (row % sx, row / sx);
        let z = run.start - row * sz..run.end - row * sz;
        // Air passes through faces and, within a level, past vertical edges: a room needs its corners.
        let rows = [
            (x > 0).then(|| (row - 1, 1)),
            (x + 1 < sx).then(|| (row + 1, 1)),
            (y > 0).then(|| (row - sx, 0)),
            (y + 1 < sy).then(|| (row + sx, 0)),
        ];
        rows.into_iter().flatten().flat_map(move |(row, reach)| {
            let own = &self.runs[self.first_of_row[row]..self.first_of_row[row + 1]];
            let first = own.partition_point(|other| other.end - row * sz + reach <= z.start);
            let end = z.end + reach;
            own[first..].iter().take_while(move |other| other.start - row * sz < end).cloned()
        })
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
            let runs = AirRuns::of(SIZE, |index| air[index]);
            let mut label = vec![0; air.len()];
            let mut regions = 0;
            for first in runs.all() {
                regions += u32::from(label[first.start] == 0);
                runs.fill(first, |run| {
                    let is_new = label[run.start] == 0;
                    if is_new {
                        label[run].fill(regions);
                    }
                    is_new
                });
            }
            prop_assert_eq!(label, by_flooding(&air));
        }
    }
}
