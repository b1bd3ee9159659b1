//! The horizontal levels of a structure, and their connected clusters.

use std::collections::HashMap;

use super::structure::Structure;

/// An `(x, z)` cell of one level.
pub type PlaneCell = (i32, i32);

/// Returns the distinct `(x, z)` cells that hold a block at `y`, sorted by x, then z.
#[must_use]
pub fn level(structure: &Structure, y: i32) -> Vec<PlaneCell> {
    sorted_distinct(structure.cells().iter().filter(|c| c.y == y).map(|c| (c.x, c.z)).collect())
}

/// Sorts `cells` by x, then z, and removes duplicates.
#[must_use]
pub fn sorted_distinct(mut cells: Vec<PlaneCell>) -> Vec<PlaneCell> {
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// The neighbourhood in which cells of a level count as touching.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// The four cells that share a side.
    Sides,
    /// The eight cells that share a side or a corner.
    SidesAndCorners,
}

impl Touch {
    /// Converts the published argument `use_8_neighbors`: eight neighbours if it is true, else four.
    #[must_use]
    pub const fn published(use_8_neighbors: bool) -> Self {
        if use_8_neighbors { Self::SidesAndCorners } else { Self::Sides }
    }
}

/// The connected clusters of a level's cells.
#[derive(Debug, Clone)]
pub struct Clusters {
    /// Cluster number of each cell; clusters are numbered from 0 in the order of their first cells.
    pub label: Vec<u32>,
    /// Number of clusters.
    pub count: usize,
}

impl Clusters {
    /// Computes the clusters of `cells`, which must be sorted and distinct, in time that depends only on their number.
    #[must_use]
    pub fn of(cells: &[PlaneCell], touch: Touch) -> Self {
        let mut at: HashMap<PlaneCell, usize, foldhash::fast::RandomState> = HashMap::default();
        at.extend(cells.iter().copied().zip(0..));
        let mut sets = DisjointSets::new(cells.len());
        // Half of the neighbours suffice: each pair is seen from one of its cells.
        let half: &[(i32, i32)] = match touch {
            Touch::Sides => &[(1, 0), (0, 1)],
            Touch::SidesAndCorners => &[(1, 0), (0, 1), (1, 1), (1, -1)],
        };
        for (i, &(x, z)) in cells.iter().enumerate() {
            for (dx, dz) in half {
                if let Some(&j) = at.get(&(x + dx, z + dz)) {
                    sets.join(i, j);
                }
            }
        }
        let mut number = vec![None; cells.len()];
        let mut count = 0u32;
        let label = (0..cells.len())
            .map(|i| {
                *number[sets.root(i)].get_or_insert_with(|| {
                    count += 1;
                    count - 1
                })
            })
            .collect();
        Self { label, count: count as usize }
    }

    /// Returns the first cell of each cluster.
    #[must_use]
    pub fn representatives(&self, cells: &[PlaneCell]) -> Vec<PlaneCell> {
        let mut firsts = Vec::with_capacity(self.count);
        for (cell, label) in cells.iter().zip(&self.label) {
            if *label as usize == firsts.len() {
                firsts.push(*cell);
            }
        }
        firsts
    }
}

/// A disjoint-set forest with path halving. The least element is the root, so the order of joins does not affect roots.
#[derive(Debug)]
pub struct DisjointSets {
    parent: Vec<usize>,
}

impl DisjointSets {
    /// Creates `n` sets of one element each.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self { parent: (0..n).collect() }
    }

    /// Returns the root of the set that contains `i`: its least element.
    pub fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    /// Merges the sets that contain `i` and `j`.
    pub fn join(&mut self, i: usize, j: usize) {
        let (a, b) = (self.root(i), self.root(j));
        self.parent[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagonal_pair_is_one_cluster_only_through_corners() {
        let cells = [(0, 0), (1, 1)];
        assert_eq!(Clusters::of(&cells, Touch::Sides).count, 2);
        assert_eq!(Clusters::of(&cells, Touch::SidesAndCorners).count, 1);
    }

    #[test]
    fn representatives_are_the_first_cells() {
        let cells = [(0, 0), (0, 1), (5, 5), (6, 5)];
        let clusters = Clusters::of(&cells, Touch::Sides);
        assert_eq!(clusters.label, [0, 0, 1, 1]);
        assert_eq!(clusters.representatives(&cells), [(0, 0), (5, 5)]);
    }
}
