//! Regions of space in which the anchor of a moving box is free everywhere or nowhere.
//!
//! Each row of blocks along z keeps the anchor out of a cuboid, which is larger than the row by the size of the box. A tree
//! divides space where such cuboids begin and end, until each region lies wholly inside one of them or wholly outside all of
//! them. The tree grows only where it is queried.

use crate::voxel::cell::Cell;

/// A cuboid of anchors: the least and the greatest x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cuboid {
    pub min: [i32; 3],
    pub max: [i32; 3],
}

/// The number of a node, a free region or an obstacle.
type Index = u32;

/// A part of the tree. Queries pass many of them, so they are small.
#[derive(Debug, Clone, Copy)]
enum Node {
    /// Nobody has asked for it yet; its number in the list of such parts.
    Undivided(Index),
    /// Two parts, of which the second begins at `cut` on the axis. Its number follows that of the first.
    Divided {
        axis: u8,
        cut: i32,
        first: Index,
    },
    Blocked,
    /// The number of the free region.
    Free(Index),
}

/// A space that is not divided yet, and the obstacles that reach into it, of which none fills it.
#[derive(Debug)]
struct Undivided {
    space: Cuboid,
    obstacles: Vec<Index>,
}

/// The tree.
#[derive(Debug)]
pub(super) struct Regions {
    /// What the tree divides.
    space: Cuboid,
    size: [i32; 3],
    obstacles: Vec<Cuboid>,
    nodes: Vec<Node>,
    undivided: Vec<Undivided>,
    free: Vec<Cuboid>,
    /// Nodes that a query still has to look at, kept to reuse its allocation.
    open: Vec<Index>,
}

impl Cuboid {
    /// Returns the least cuboid that holds both.
    pub(super) fn around(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    pub(super) fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    fn covers(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }

    /// Returns the places along an axis at which an obstacle begins or ends within this cuboid.
    fn edges_of(&self, obstacle: &Self, axis: usize) -> impl Iterator<Item = i32> {
        let (min, max) = (self.min[axis], self.max[axis]);
        [obstacle.min[axis], obstacle.max[axis] + 1].into_iter().filter(move |edge| (min + 1..=max).contains(edge))
    }
}

/// Returns what solid cells keep the anchor of a box out of. Cells of one row that leave no anchor between them make one
/// obstacle.
fn obstacles(solid: &[Cell], size: [i32; 3]) -> Vec<Cuboid> {
    let mut sorted = solid.to_vec();
    sorted.sort_unstable_by_key(|cell| (cell.x, cell.y, cell.z));
    let is_close = |a: &Cell, b: &Cell| (a.x, a.y) == (b.x, b.y) && b.z - a.z <= size[2];
    let obstacle = |row: &[Cell]| {
        let (first, last) = (row[0], row[row.len() - 1]);
        let min = [first.x - size[0] + 1, first.y - size[1] + 1, first.z - size[2] + 1];
        Cuboid { min, max: [last.x, last.y, last.z] }
    };
    sorted.chunk_by(is_close).map(obstacle).collect()
}

impl Regions {
    /// Prepares the tree for a box of `size`, along x, y and z, among solid cells. The tree covers the levels from
    /// `levels[0]` to `levels[1]`, and along x and z all anchors at which something can be in the way, with one more at
    /// each side.
    pub(super) fn new(solid: &[Cell], levels: [i32; 2], size: [i32; 3]) -> Self {
        let obstacles = obstacles(solid, size);
        let least = |axis: usize| obstacles.iter().map(|one| one.min[axis]).min().unwrap_or(0);
        let greatest = |axis: usize| obstacles.iter().map(|one| one.max[axis]).max().unwrap_or(0);
        let space =
            Cuboid { min: [least(0) - 1, levels[0], least(2) - 1], max: [greatest(0) + 1, levels[1], greatest(2) + 1] };
        let root = Undivided { space, obstacles: (0..obstacles.len() as Index).collect() };
        let (nodes, undivided) = (vec![Node::Undivided(0)], vec![root]);
        Self { space, size, obstacles, nodes, undivided, free: Vec::new(), open: Vec::new() }
    }

    /// Returns the space that the tree covers.
    pub(super) const fn space(&self) -> &Cuboid {
        &self.space
    }

    /// Returns a free region by its number.
    pub(super) fn free(&self, number: Index) -> &Cuboid {
        &self.free[number as usize]
    }

    /// Appends the numbers of the free regions that meet a space to `found`.
    pub(super) fn find(&mut self, space: &Cuboid, found: &mut Vec<Index>) {
        let mut open = std::mem::take(&mut self.open);
        open.push(0);
        while let Some(number) = open.pop() {
            match self.nodes[number as usize] {
                Node::Blocked => {}
                Node::Free(region) => found.push(region),
                Node::Divided { axis, cut, first } => {
                    if space.max[usize::from(axis)] >= cut {
                        open.push(first + 1);
                    }
                    if space.min[usize::from(axis)] < cut {
                        open.push(first);
                    }
                }
                Node::Undivided(one) => {
                    self.nodes[number as usize] = self.divided(one);
                    open.push(number);
                }
            }
        }
        self.open = open;
    }

    /// Divides a space in two, or makes it a free region if nothing reaches into it.
    fn divided(&mut self, number: Index) -> Node {
        let obstacles = std::mem::take(&mut self.undivided[number as usize].obstacles);
        let space = self.undivided[number as usize].space;
        let Some((axis, cut)) = self.cut(&space, &obstacles) else {
            self.free.push(space);
            return Node::Free(self.free.len() as Index - 1);
        };
        let (mut below, mut above) = (space, space);
        below.max[axis] = cut - 1;
        above.min[axis] = cut;
        // One of the parts takes the place of the whole.
        let mut place = Some(number);
        let first = self.nodes.len() as Index;
        for part in [below, above] {
            let node = match self.reaching(part, &obstacles) {
                None => Node::Blocked,
                Some(part) => Node::Undivided(if let Some(place) = place.take() {
                    self.undivided[place as usize] = part;
                    place
                } else {
                    self.undivided.push(part);
                    self.undivided.len() as Index - 1
                }),
            };
            self.nodes.push(node);
        }
        Node::Divided { axis: axis as u8, cut, first }
    }

    /// Finds the obstacles that reach into a space. Returns `None` if one of them fills it.
    fn reaching(&self, space: Cuboid, obstacles: &[Index]) -> Option<Undivided> {
        let mut reaching = Vec::new();
        for number in obstacles {
            let obstacle = &self.obstacles[*number as usize];
            if obstacle.covers(&space) {
                return None;
            }
            if obstacle.meets(&space) {
                reaching.push(*number);
            }
        }
        Some(Undivided { space, obstacles: reaching })
    }

    /// Returns where to divide a space: at the median of the edges in it, across the side that is longest relative to the
    /// box. Returns `None` if there is no edge in it.
    fn cut(&self, space: &Cuboid, obstacles: &[Index]) -> Option<(usize, i32)> {
        let length =
            |axis: &usize| i64::from(space.max[*axis] - space.min[*axis]) * 5_040 / i64::from(self.size[*axis]);
        let mut axes = [0, 1, 2];
        axes.sort_by_key(|axis| std::cmp::Reverse(length(axis)));
        axes.into_iter().find_map(|axis| {
            let edges = obstacles.iter().flat_map(|number| space.edges_of(&self.obstacles[*number as usize], axis));
            let mut edges: Vec<i32> = edges.collect();
            let middle = edges.len() / 2;
            (!edges.is_empty()).then(|| (axis, *edges.select_nth_unstable(middle).1))
        })
    }
}
