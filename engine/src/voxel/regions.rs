//! Regions of the plane of x and y in which the same blocks are in the way of a moving box.
//!
//! Seen along z, the blocks of one line `(x, y)` keep the anchor of the box out of a rectangle as wide and as high as the
//! box. Such rectangles overlap. A tree divides the plane where they begin and end, until each region lies as a whole in or
//! outside of each of them: then the box fits at the same z everywhere in the region. The tree grows only where it is asked.

use super::cell::Cell;

/// A closed interval of z.
pub(super) type Span = (i32, i32);

/// The intervals in which the anchor is blocked: sorted, neither overlapping nor touching.
pub(super) type Blocked = Vec<Span>;

/// A rectangle of anchors: the least and the greatest x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    pub min: [i32; 2],
    pub max: [i32; 2],
}

/// An area in which the anchor is blocked at the same z everywhere.
#[derive(Debug)]
pub(super) struct Region {
    pub area: Area,
    pub blocked: Blocked,
}

/// What the blocks of one line keep the anchor out of.
#[derive(Debug)]
struct Shadow {
    area: Area,
    blocked: Blocked,
}

/// Greatest number of lines in an area that is divided into all of its lines at once, where it has as many shadows as lines.
const MOST_LINES: usize = 32;

/// The number of a node, a region or a shadow.
type Index = u32;

/// A part of the tree.
#[derive(Debug)]
enum Node {
    /// Nobody has asked for it yet.
    Undivided {
        area: Area,
        /// What the shadows block that cover the whole area.
        blocked: Blocked,
        /// The shadows that cover a part of it.
        partial: Vec<Index>,
    },
    /// Two parts, of which the second begins at `cut` on the axis. Its number follows that of the first.
    Divided {
        axis: usize,
        cut: i32,
        first: Index,
    },
    Region(Index),
    /// A region for each line of a small area, row by row, from this number on.
    Lines {
        area: Area,
        first: Index,
    },
}

/// The tree, which covers an area.
#[derive(Debug)]
pub(super) struct Regions {
    area: Area,
    /// Width and height of the box.
    size: [i32; 2],
    shadows: Vec<Shadow>,
    nodes: Vec<Node>,
    regions: Vec<Region>,
}

impl Area {
    /// Returns the number of lines, which may be huge.
    fn lines(&self) -> usize {
        (0..2).map(|axis| (self.max[axis] - self.min[axis]) as usize + 1).product()
    }

    /// Returns the x and y of each line, row by row.
    fn places(self) -> impl Iterator<Item = (i32, i32)> {
        (self.min[1]..=self.max[1]).flat_map(move |y| (self.min[0]..=self.max[0]).map(move |x| (x, y)))
    }

    /// Returns what is in both areas, which meet.
    pub fn common(&self, other: &Self) -> Self {
        Self {
            min: [self.min[0].max(other.min[0]), self.min[1].max(other.min[1])],
            max: [self.max[0].min(other.max[0]), self.max[1].min(other.max[1])],
        }
    }

    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    fn covers(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }

    /// Returns the places at which a shadow begins or ends within this area, along an axis.
    fn cuts(&self, shadow: &Self, axis: usize) -> impl Iterator<Item = i32> {
        let (min, max) = (self.min[axis], self.max[axis]);
        [shadow.min[axis], shadow.max[axis] + 1].into_iter().filter(move |cut| (min + 1..=max).contains(cut))
    }
}

/// Sorts intervals, and joins those that overlap or touch.
fn joined(mut blocked: Blocked) -> Blocked {
    // What is given often consists of a few sorted parts.
    blocked.sort();
    blocked.dedup_by(|next, last| {
        let joins = next.0 <= last.1 + 1;
        if joins {
            last.1 = last.1.max(next.1);
        }
        joins
    });
    blocked
}

impl Regions {
    /// Prepares the tree for a box of `size`, along x, y and z, among solid cells. It covers the levels from `levels[0]` to `levels[1]`, and
    /// along x all anchors at which something can be in the way, with one more at each side.
    pub(super) fn new(solid: &[Cell], levels: [i32; 2], size: [i32; 3]) -> Self {
        let mut sorted: Vec<Cell> = solid.to_vec();
        sorted.sort_unstable_by_key(|cell| (cell.x, cell.y, cell.z));
        let lines = sorted.chunk_by(|a, b| (a.x, a.y) == (b.x, b.y));
        let shadow = |line: &[Cell]| Shadow {
            area: Area { min: [line[0].x - size[0] + 1, line[0].y - size[1] + 1], max: [line[0].x, line[0].y] },
            blocked: joined(line.iter().map(|cell| (cell.z - size[2] + 1, cell.z)).collect()),
        };
        let shadows: Vec<Shadow> = lines.map(shadow).collect();
        let ends = [sorted.first(), sorted.last()].map(|cell| cell.map_or(0, |cell| cell.x));
        let area = Area { min: [ends[0] - size[0], levels[0]], max: [ends[1] + 1, levels[1]] };
        let mut tree = Self { area, size: [size[0], size[1]], shadows, nodes: Vec::new(), regions: Vec::new() };
        let root = tree.undivided(area, Vec::new(), 0..tree.shadows.len() as Index);
        tree.nodes.push(root);
        tree
    }

    /// Returns the area that the tree covers.
    pub(super) fn area(&self) -> Area {
        self.area
    }

    /// Returns a region by its number.
    pub(super) fn region(&self, number: Index) -> &Region {
        &self.regions[number as usize]
    }

    /// Appends the numbers of the regions that meet an area to `found`.
    pub(super) fn find(&mut self, area: &Area, found: &mut Vec<Index>) {
        let mut open: Vec<Index> = vec![0];
        while let Some(number) = open.pop() {
            match self.nodes[number as usize] {
                Node::Region(region) => found.push(region),
                Node::Lines { area: all, first } => {
                    let width = all.max[0] - all.min[0] + 1;
                    let number = |(x, y)| first + ((y - all.min[1]) * width + x - all.min[0]) as Index;
                    found.extend(all.common(area).places().map(number));
                }
                Node::Divided { axis, cut, first } => {
                    if area.max[axis] >= cut {
                        open.push(first + 1);
                    }
                    if area.min[axis] < cut {
                        open.push(first);
                    }
                }
                Node::Undivided { .. } => {
                    self.divide(number);
                    open.push(number);
                }
            }
        }
    }

    /// Divides a node in two, or makes it a region.
    fn divide(&mut self, number: Index) {
        let next = self.nodes.len() as Index;
        let region = Node::Region(self.regions.len() as Index);
        let Node::Undivided { area, blocked, partial } = std::mem::replace(&mut self.nodes[number as usize], region)
        else {
            unreachable!("only undivided nodes are divided");
        };
        if area.lines() <= MOST_LINES.min(partial.len()) {
            self.nodes[number as usize] = Node::Lines { area, first: self.regions.len() as Index };
            self.add_lines(&area, &blocked, &partial);
            return;
        }
        let Some((axis, cut)) = self.cut(&area, &partial) else {
            self.regions.push(Region { area, blocked });
            return;
        };
        self.nodes[number as usize] = Node::Divided { axis, cut, first: next };
        let (mut below, mut above) = (area, area);
        below.max[axis] = cut - 1;
        above.min[axis] = cut;
        let below = self.undivided(below, blocked.clone(), partial.iter().copied());
        let above = self.undivided(above, blocked, partial.iter().copied());
        self.nodes.extend([below, above]);
    }

    /// Makes a region of each line of an area.
    fn add_lines(&mut self, area: &Area, blocked: &[Span], partial: &[Index]) {
        for (x, y) in area.places() {
            let area = Area { min: [x, y], max: [x, y] };
            let shadows = partial.iter().map(|number| &self.shadows[*number as usize]);
            let own = shadows.filter(|shadow| shadow.area.covers(&area)).flat_map(|shadow| &shadow.blocked);
            let blocked = joined(blocked.iter().chain(own).copied().collect());
            self.regions.push(Region { area, blocked });
        }
    }

    /// Makes a node of an area, of what covers all of the area around it, and of the shadows that cover a part of that.
    fn undivided(&self, area: Area, mut blocked: Blocked, shadows: impl Iterator<Item = Index>) -> Node {
        let mut partial = Vec::new();
        let before = blocked.len();
        for number in shadows {
            let shadow = &self.shadows[number as usize];
            if shadow.area.covers(&area) {
                blocked.extend_from_slice(&shadow.blocked);
            } else if shadow.area.meets(&area) {
                partial.push(number);
            }
        }
        if blocked.len() > before {
            blocked = joined(blocked);
        }
        Node::Undivided { area, blocked, partial }
    }

    /// Returns where to divide an area: in the middle of what begins and ends in it, across its longer side as measured by
    /// the box. Returns `None` if nothing begins or ends in it.
    fn cut(&self, area: &Area, partial: &[Index]) -> Option<(usize, i32)> {
        let length = |axis: usize| i64::from(area.max[axis] - area.min[axis]) * i64::from(self.size[1 - axis]);
        let longer = usize::from(length(1) > length(0));
        [longer, 1 - longer].into_iter().find_map(|axis| {
            let shadows = partial.iter().map(|number| &self.shadows[*number as usize].area);
            let mut cuts: Vec<i32> = shadows.flat_map(|shadow| area.cuts(shadow, axis)).collect();
            let middle = cuts.len() / 2;
            (!cuts.is_empty()).then(|| (axis, *cuts.select_nth_unstable(middle).1))
        })
    }
}
