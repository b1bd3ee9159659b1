//! Regions of space in which the anchor of a moving box is free everywhere or nowhere.
//!
//! Each row of blocks along z keeps the anchor out of a cuboid, which is larger than the row by the size of the box. A tree
//! divides space where such cuboids begin and end, until each region lies wholly inside one of them or wholly outside all of
//! them. The tree grows only where it is searched, and loses what is taken from it: a search does not meet a region twice.

use crate::voxel::cell::Cell;

/// A cuboid of anchors: the least and the greatest x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cuboid {
    pub min: [i32; 3],
    pub max: [i32; 3],
}

/// The number of a node, a free region or an obstacle.
type Index = u32;

/// A part of the tree. Searches pass many of them, so they are small.
#[derive(Debug, Clone, Copy)]
enum Node {
    /// No search has come here yet; its number in the list of such parts.
    Undivided(Index),
    /// Two parts, of which the second begins at `cut` on the axis. Its number follows that of the first.
    Divided { axis: u8, cut: i32, first: Index },
    /// Nothing is free here, or all that was free has been taken.
    Spent,
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
pub(super) struct Regions<'a> {
    /// What the tree divides.
    space: Cuboid,
    size: [i32; 3],
    obstacles: Vec<Cuboid>,
    nodes: Vec<Node>,
    undivided: Vec<Undivided>,
    free: Vec<Cuboid>,
    /// Nodes at which a search still has to look, kept to reuse its allocation.
    open: Vec<Index>,
    /// The places at which a space can be divided, kept for the same reason.
    edges: Vec<i32>,
    is_stopped: &'a dyn Fn() -> bool,
    /// Work since the last poll of the stop signal: nodes, and obstacles that were compared with a space.
    work: usize,
}

/// Work between two polls of the stop signal.
const WORK_PER_LOOK: usize = 100_000;

impl Cuboid {
    /// Returns the least cuboid that holds both.
    fn around(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// Returns whether the region is a single cell wide.
    pub(super) const fn is_shaft(&self) -> bool {
        self.min[0] == self.max[0] && self.min[2] == self.max[2]
    }

    fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    fn covers(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
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

impl<'a> Regions<'a> {
    /// Prepares the tree for a box of `size`, along x, y and z, among solid cells. The tree covers the levels from
    /// `levels[0]` to `levels[1]`, and along x and z all anchors at which something can be in the way, with one more at
    /// each side.
    pub(super) fn new(solid: &[Cell], levels: [i32; 2], size: [i32; 3], is_stopped: &'a dyn Fn() -> bool) -> Self {
        let obstacles = obstacles(solid, size);
        let least = |axis: usize| obstacles.iter().map(|one| one.min[axis]).min().unwrap_or(0);
        let greatest = |axis: usize| obstacles.iter().map(|one| one.max[axis]).max().unwrap_or(0);
        let space =
            Cuboid { min: [least(0) - 1, levels[0], least(2) - 1], max: [greatest(0) + 1, levels[1], greatest(2) + 1] };
        let root = Undivided { space, obstacles: (0..obstacles.len() as Index).collect() };
        Self {
            space,
            size,
            obstacles,
            nodes: vec![Node::Undivided(0)],
            undivided: vec![root],
            free: Vec::new(),
            open: Vec::new(),
            edges: Vec::new(),
            is_stopped,
            work: WORK_PER_LOOK,
        }
    }

    /// Returns the space that the tree covers.
    pub(super) const fn space(&self) -> &Cuboid {
        &self.space
    }

    /// Takes the free regions that meet one of the spaces out of the tree, and appends them to `taken`. The spaces have the
    /// same levels. Of a shaft it takes the cells on those levels, each as a region of its own.
    ///
    /// Returns `None` if the search is to stop.
    pub(super) fn take(&mut self, spaces: &[Cuboid], taken: &mut Vec<Cuboid>) -> Option<()> {
        let around = spaces.iter().copied().reduce(|a, b| a.around(&b)).expect("a search has a space");
        let is_wanted = |region: &Cuboid| spaces.iter().any(|space| space.meets(region));
        let mut open = std::mem::take(&mut self.open);
        open.push(0);
        while let Some(number) = open.pop() {
            self.look()?;
            match self.nodes[number as usize] {
                Node::Spent => {}
                Node::Divided { axis, cut, first } => {
                    match [self.nodes[first as usize], self.nodes[first as usize + 1]] {
                        // The other part takes the place of both. Its space may then seem larger than it is, but a space or
                        // a region is compared when it is reached.
                        [Node::Spent, rest] | [rest, Node::Spent] => {
                            self.nodes[number as usize] = rest;
                            open.push(number);
                        }
                        _ => {
                            if around.max[usize::from(axis)] >= cut {
                                open.push(first + 1);
                            }
                            if around.min[usize::from(axis)] < cut {
                                open.push(first);
                            }
                        }
                    }
                }
                Node::Undivided(one) => {
                    if is_wanted(&self.undivided[one as usize].space) {
                        self.nodes[number as usize] = self.divided(one);
                        open.push(number);
                    }
                }
                Node::Free(region) => {
                    if is_wanted(&self.free[region as usize]) {
                        self.nodes[number as usize] = self.left_of(region, [around.min[1], around.max[1]], taken);
                    }
                }
            }
        }
        self.open = open;
        Some(())
    }

    /// Polls the stop signal from time to time.
    fn look(&mut self) -> Option<()> {
        self.work += 1;
        if self.work >= WORK_PER_LOOK {
            self.work = 0;
            if (self.is_stopped)() {
                return None;
            }
        }
        Some(())
    }

    /// Takes a free region, or of a shaft the cells on some levels. Returns the node that stays.
    fn left_of(&mut self, number: Index, levels: [i32; 2], taken: &mut Vec<Cuboid>) -> Node {
        let region = self.free[number as usize];
        if !region.is_shaft() {
            taken.push(region);
            return Node::Spent;
        }
        let on = |bottom: i32, top: i32| Cuboid {
            min: [region.min[0], bottom, region.min[2]],
            max: [region.max[0], top, region.max[2]],
        };
        let (bottom, top) = (region.min[1].max(levels[0]), region.max[1].min(levels[1]));
        taken.extend((bottom..=top).map(|level| on(level, level)));
        let rests = [on(region.min[1], bottom - 1), on(top + 1, region.max[1])];
        match rests.map(|rest| rest.min[1] <= rest.max[1]) {
            [false, false] => Node::Spent,
            [true, false] => self.now(number, rests[0]),
            [false, true] => self.now(number, rests[1]),
            [true, true] => {
                let first = self.nodes.len() as Index;
                let below = self.now(number, rests[0]);
                self.free.push(rests[1]);
                let above = Node::Free(self.free.len() as Index - 1);
                self.nodes.extend([below, above]);
                Node::Divided { axis: 1, cut: top + 1, first }
            }
        }
    }

    /// Makes a free region smaller.
    fn now(&mut self, number: Index, region: Cuboid) -> Node {
        self.free[number as usize] = region;
        Node::Free(number)
    }

    /// Divides a space in two, or makes it a free region if nothing reaches into it.
    fn divided(&mut self, number: Index) -> Node {
        let obstacles = std::mem::take(&mut self.undivided[number as usize].obstacles);
        let space = self.undivided[number as usize].space;
        self.work += obstacles.len();
        let Some((axis, cut)) = self.cut(&space, &obstacles) else {
            self.free.push(space);
            return Node::Free(self.free.len() as Index - 1);
        };
        let (mut below, mut above) = (space, space);
        below.max[axis] = cut - 1;
        above.min[axis] = cut;
        match [self.reaching(below, &obstacles), self.reaching(above, &obstacles)] {
            [None, None] => Node::Spent,
            // The part takes the place of the whole.
            [Some(part), None] | [None, Some(part)] => {
                self.undivided[number as usize] = part;
                Node::Undivided(number)
            }
            [Some(below), Some(above)] => {
                let first = self.nodes.len() as Index;
                self.undivided[number as usize] = below;
                self.undivided.push(above);
                self.nodes.extend([Node::Undivided(number), Node::Undivided(self.undivided.len() as Index - 1)]);
                Node::Divided { axis: axis as u8, cut, first }
            }
        }
    }

    /// Finds the obstacles that reach into a space. Returns `None` if one of them fills it.
    fn reaching(&self, space: Cuboid, obstacles: &[Index]) -> Option<Undivided> {
        let mut reaching = Vec::with_capacity(obstacles.len());
        for number in obstacles {
            let obstacle = &self.obstacles[*number as usize];
            if obstacle.covers(&space) {
                return None;
            }
            if obstacle.meets(&space) {
                reaching.push(*number);
            }
        }
        if reaching.len() < obstacles.len() / 2 {
            reaching.shrink_to_fit();
        }
        Some(Undivided { space, obstacles: reaching })
    }

    /// Returns where to divide a space: at the median of the edges in it, across the side that is longest relative to the
    /// box. Returns `None` if there is no edge in it.
    fn cut(&mut self, space: &Cuboid, obstacles: &[Index]) -> Option<(usize, i32)> {
        let length =
            |axis: &usize| i64::from(space.max[*axis] - space.min[*axis]) * 5_040 / i64::from(self.size[*axis]);
        let mut axes = [0, 1, 2];
        axes.sort_by_key(|axis| std::cmp::Reverse(length(axis)));
        axes.into_iter().find_map(|axis| {
            self.edges.clear();
            for number in obstacles {
                let obstacle = &self.obstacles[*number as usize];
                let edges = [obstacle.min[axis], obstacle.max[axis] + 1];
                self.edges
                    .extend(edges.into_iter().filter(|edge| (space.min[axis] + 1..=space.max[axis]).contains(edge)));
            }
            let middle = self.edges.len() / 2;
            (!self.edges.is_empty()).then(|| (axis, *self.edges.select_nth_unstable(middle).1))
        })
    }
}
