//! The horizontal levels of a structure, and their connected clusters.

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
        let mut sets = DisjointSets::new(cells.len());
        let reach = match touch {
            Touch::Sides => 0,
            Touch::SidesAndCorners => 1,
        };
        // Half of the neighbours suffice: each pair is seen from its first cell. Those with the next x lie in order, so
        // the first of them only moves ahead.
        let mut ahead = 0;
        for (i, &(x, z)) in cells.iter().enumerate() {
            if cells.get(i + 1) == Some(&(x, z + 1)) {
                sets.join(i, i + 1);
            }
            while cells.get(ahead).is_some_and(|other| *other < (x + 1, z - reach)) {
                ahead += 1;
            }
            let beside = cells[ahead..].iter().take_while(|other| **other <= (x + 1, z + reach));
            for (j, _) in (ahead..).zip(beside) {
                sets.join(i, j);
            }
        }
        let (label, count) = sets.numbers();
        Self { label, count }
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

/// Returns the extents along x and z of each cluster of `cells`.
#[must_use]
pub fn extents(cells: &[PlaneCell], clusters: &Clusters) -> Vec<[u32; 2]> {
    let sides = |[x0, x1, z0, z1]: [i32; 4]| [x0.abs_diff(x1) + 1, z0.abs_diff(z1) + 1];
    rectangles(cells, clusters).into_iter().map(sides).collect()
}

/// Returns the least and greatest x, and the least and greatest z, of each cluster of `cells`.
#[must_use]
pub fn rectangles(cells: &[PlaneCell], clusters: &Clusters) -> Vec<[i32; 4]> {
    let mut bounds: Vec<Option<[i32; 4]>> = vec![None; clusters.count];
    for (&(x, z), label) in cells.iter().zip(&clusters.label) {
        let [x0, x1, z0, z1] = bounds[*label as usize].unwrap_or([x, x, z, z]);
        bounds[*label as usize] = Some([x0.min(x), x1.max(x), z0.min(z), z1.max(z)]);
    }
    bounds.into_iter().flatten().collect()
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

    /// Numbers the sets from 0 in the order of their least elements. Returns the number of each element's set, and how
    /// many sets there are.
    #[must_use]
    pub fn numbers(mut self) -> (Vec<u32>, usize) {
        let mut numbers: Vec<u32> = Vec::with_capacity(self.parent.len());
        let mut count = 0;
        for i in 0..self.parent.len() {
            let root = self.root(i);
            numbers.push(if root == i { count } else { numbers[root] });
            count += u32::from(root == i);
        }
        (numbers, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_diagonal_pair_is_one_cluster_only_through_corners() {
        let cells = [(0, 0), (1, 1)];
        assert_eq!(Clusters::of(&cells, Touch::Sides).count, 2);
        assert_eq!(Clusters::of(&cells, Touch::SidesAndCorners).count, 1);
    }

    proptest! {
        #[test]
        fn clusters_are_those_that_flooding_finds(
            cells in prop::collection::vec((-4..4i32, -4..4i32), 0..40),
            use_8_neighbors in any::<bool>(),
        ) {
            let cells = sorted_distinct(cells);
            let reach = if use_8_neighbors { 2 } else { 1 };
            let touches = |a: PlaneCell, b: PlaneCell| {
                let [dx, dz] = [a.0.abs_diff(b.0), a.1.abs_diff(b.1)];
                dx.max(dz) == 1 && dx + dz <= reach
            };
            let mut label: Vec<Option<u32>> = vec![None; cells.len()];
            let mut count = 0;
            for start in 0..cells.len() {
                if label[start].is_some() {
                    continue;
                }
                label[start] = Some(count);
                let mut open = vec![start];
                while let Some(i) = open.pop() {
                    for j in (0..cells.len()).filter(|j| touches(cells[i], cells[*j])) {
                        if label[j].replace(count).is_none() {
                            open.push(j);
                        }
                    }
                }
                count += 1;
            }
            let clusters = Clusters::of(&cells, Touch::published(use_8_neighbors));
            prop_assert_eq!(clusters.count, count as usize);
            prop_assert_eq!(clusters.label.into_iter().map(Some).collect::<Vec<_>>(), label);
        }
    }

    #[test]
    fn representatives_are_the_first_cells() {
        let cells = [(0, 0), (0, 1), (5, 5), (6, 5)];
        let clusters = Clusters::of(&cells, Touch::Sides);
        assert_eq!(clusters.label, [0, 0, 1, 1]);
        assert_eq!(clusters.representatives(&cells), [(0, 0), (5, 5)]);
    }
}
