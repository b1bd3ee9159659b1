//! Distances between cells of a level: the greatest within a set, and the least between clusters.

use super::planar::PlaneCell;

/// Two cells and the square of the Euclidean distance between their centres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    /// First cell of the pair.
    pub a: PlaneCell,
    /// Second cell of the pair.
    pub b: PlaneCell,
    /// Square of the distance, in cells squared.
    pub squared: i64,
}

impl Pair {
    fn of(a: PlaneCell, b: PlaneCell) -> Self {
        Self { a, b, squared: squared(a, b) }
    }

    /// Returns the distance in cells.
    #[must_use]
    pub fn length(&self) -> f64 {
        root(self.squared as f64)
    }
}

/// Computes the square root as the published evaluator does: as the power of one half, which differs from `sqrt` in the
/// last bit for a few values (conformance quirk 6).
#[must_use]
pub fn root(squared: f64) -> f64 {
    // The compiler would replace a power of one half that it sees by `sqrt`.
    squared.powf(std::hint::black_box(0.5))
}

fn squared(a: PlaneCell, b: PlaneCell) -> i64 {
    let (dx, dz) = (i64::from(a.0) - i64::from(b.0), i64::from(a.1) - i64::from(b.1));
    dx * dx + dz * dz
}

/// Finds the two cells farthest apart by rotating callipers over the convex hull. Returns `None` if there are no cells.
///
/// `cells` must be sorted and distinct.
#[must_use]
pub fn farthest_pair(cells: &[PlaneCell]) -> Option<Pair> {
    let hull = convex_hull(cells);
    let first = *hull.first()?;
    let mut best = Pair::of(first, first);
    let n = hull.len();
    if n <= 3 {
        for (i, &a) in hull.iter().enumerate() {
            for &b in &hull[i + 1..] {
                best = farther(best, Pair::of(a, b));
            }
        }
        return Some(best);
    }
    let mut j = 1;
    for i in 0..n {
        let edge = (hull[i], hull[(i + 1) % n]);
        while turn(edge.0, edge.1, hull[(j + 1) % n]).abs() > turn(edge.0, edge.1, hull[j]).abs() {
            j = (j + 1) % n;
        }
        for b in [hull[j], hull[(j + 1) % n]] {
            best = farther(farther(best, Pair::of(edge.0, b)), Pair::of(edge.1, b));
        }
    }
    Some(best)
}

fn farther(a: Pair, b: Pair) -> Pair {
    if b.squared > a.squared { b } else { a }
}

/// Computes twice the signed area of the triangle `o a b`.
fn turn(o: PlaneCell, a: PlaneCell, b: PlaneCell) -> i64 {
    let (ax, az) = (i64::from(a.0) - i64::from(o.0), i64::from(a.1) - i64::from(o.1));
    let (bx, bz) = (i64::from(b.0) - i64::from(o.0), i64::from(b.1) - i64::from(o.1));
    ax * bz - az * bx
}

/// Computes the corners of the convex hull in order (Andrew's monotone chain), without points in the middle of an edge.
fn convex_hull(cells: &[PlaneCell]) -> Vec<PlaneCell> {
    if cells.len() < 3 {
        return cells.to_vec();
    }
    let mut hull: Vec<PlaneCell> = Vec::new();
    let mut half = |points: &mut dyn Iterator<Item = PlaneCell>| {
        let start = hull.len();
        for p in points {
            while hull.len() >= start + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0 {
                hull.pop();
            }
            hull.push(p);
        }
        // The last point is the first point of the other half.
        hull.pop();
    };
    half(&mut cells.iter().copied());
    half(&mut cells.iter().rev().copied());
    hull
}

/// Finds the two closest cells with different labels. Returns `None` if there are fewer than two labels.
#[must_use]
pub fn closest_pair_between(cells: &[PlaneCell], label: &[u32]) -> Option<Pair> {
    let mut order: Vec<u32> = (0..u32::try_from(cells.len()).ok()?).collect();
    let mut nodes = Vec::new();
    if cells.is_empty() {
        return None;
    }
    let tree = Tree { cells, label };
    let top = tree.build(&mut order, 0, &mut nodes);
    let mut best: Option<Pair> = None;
    for (i, &cell) in cells.iter().enumerate() {
        tree.search(&nodes, &order, top, cell, label[i], &mut best);
    }
    best
}

/// A k-d tree whose nodes record whether all their cells share one label, so that a search can skip its own cluster.
struct Tree<'a> {
    cells: &'a [PlaneCell],
    label: &'a [u32],
}

struct Node {
    low: PlaneCell,
    high: PlaneCell,
    only_label: Option<u32>,
    children: Option<(usize, usize)>,
    from: usize,
    to: usize,
}

impl Tree<'_> {
    const LEAF: usize = 8;

    fn build(&self, order: &mut [u32], from: usize, nodes: &mut Vec<Node>) -> usize {
        let mut low = (i32::MAX, i32::MAX);
        let mut high = (i32::MIN, i32::MIN);
        let mut only_label = order.first().map(|&i| self.label[i as usize]);
        for &i in order.iter() {
            let (x, z) = self.cells[i as usize];
            low = (low.0.min(x), low.1.min(z));
            high = (high.0.max(x), high.1.max(z));
            if only_label != Some(self.label[i as usize]) {
                only_label = None;
            }
        }
        let mut children = None;
        if order.len() > Self::LEAF && only_label.is_none() || order.len() > Self::LEAF * 8 {
            let middle = order.len() / 2;
            let wide_in_x = i64::from(high.0) - i64::from(low.0) >= i64::from(high.1) - i64::from(low.1);
            order.select_nth_unstable_by_key(middle, |&i| {
                let (x, z) = self.cells[i as usize];
                if wide_in_x { (x, z) } else { (z, x) }
            });
            let (left, right) = order.split_at_mut(middle);
            children = Some((self.build(left, from, nodes), self.build(right, from + middle, nodes)));
        }
        nodes.push(Node { low, high, only_label, children, from, to: from + order.len() });
        nodes.len() - 1
    }

    fn search(&self, nodes: &[Node], order: &[u32], at: usize, from: PlaneCell, label: u32, best: &mut Option<Pair>) {
        let node = &nodes[at];
        let hopeless = best.is_some_and(|best| distance_to_box(from, node) >= best.squared);
        if hopeless || node.only_label == Some(label) {
            return;
        }
        if let Some((left, right)) = node.children {
            let (near, far) = if distance_to_box(from, &nodes[left]) <= distance_to_box(from, &nodes[right]) {
                (left, right)
            } else {
                (right, left)
            };
            self.search(nodes, order, near, from, label, best);
            self.search(nodes, order, far, from, label, best);
            return;
        }
        for &i in &order[node.from..node.to] {
            let pair = Pair::of(from, self.cells[i as usize]);
            if self.label[i as usize] != label && best.is_none_or(|best| pair.squared < best.squared) {
                *best = Some(pair);
            }
        }
    }
}

fn distance_to_box((x, z): PlaneCell, node: &Node) -> i64 {
    squared((x, z), (x.clamp(node.low.0, node.high.0), z.clamp(node.low.1, node.high.1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::planar::{Clusters, Touch, sorted_distinct};
    use proptest::prelude::*;

    fn cells() -> impl Strategy<Value = Vec<PlaneCell>> {
        prop::collection::vec((-12..12i32, -12..12i32), 1..80).prop_map(sorted_distinct)
    }

    proptest! {
        #[test]
        fn the_farthest_pair_is_that_of_all_pairs(cells in cells()) {
            let all = cells.iter().flat_map(|&a| cells.iter().map(move |&b| squared(a, b))).max();
            prop_assert_eq!(farthest_pair(&cells).map(|p| p.squared), all);
        }

        #[test]
        fn the_closest_pair_is_that_of_all_pairs(cells in cells()) {
            let label = Clusters::of(&cells, Touch::Sides).label;
            let mut all = Vec::new();
            for (i, &a) in cells.iter().enumerate() {
                for (j, &b) in cells.iter().enumerate() {
                    if label[i] != label[j] {
                        all.push(squared(a, b));
                    }
                }
            }
            prop_assert_eq!(closest_pair_between(&cells, &label).map(|p| p.squared), all.into_iter().min());
        }
    }

    #[test]
    fn a_root_is_the_power_of_one_half() {
        // Of the squares below 10,000, Python's `**0.5` differs from `sqrt` for these.
        let differing = [2921, 3541, 5579, 7827, 8414, 8415];
        let found: Vec<i32> = (1..10_000).filter(|&n| root(f64::from(n)) != f64::from(n).sqrt()).collect();
        assert_eq!(found, differing);
        assert_eq!(root(2921.0).to_bits(), 54.046_276_467_486_635_f64.to_bits());
    }

    #[test]
    fn two_clusters_of_fifty_thousand_cells_a_million_apart() {
        let one = (0..250).flat_map(|x| (0..200).map(move |z| (x, z)));
        let other = (0..250).flat_map(|x| (0..200).map(move |z| (x, 1_000_000 + z)));
        let cells = sorted_distinct(one.chain(other).collect());
        let label = Clusters::of(&cells, Touch::Sides).label;
        let closest = closest_pair_between(&cells, &label).unwrap();
        assert_eq!(closest.squared, (1_000_000 - 199) * (1_000_000 - 199));
    }
}
