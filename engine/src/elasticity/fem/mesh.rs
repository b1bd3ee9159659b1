//! Mesh of blocks with their corners as nodes, and the blocks that are supported.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use super::element::CORNERS;
use super::shares::half;
use crate::voxel::connectivity::linked_by_faces;
use crate::voxel::{Cell, CellMap};

/// Blocks joined at their faces, with the nodes that they share.
///
/// Blocks that touch only at an edge or a corner have separate nodes there. Such a contact carries nothing: it would be
/// a hinge that turns freely.
#[derive(Debug)]
pub struct Mesh {
    /// Distinct cells of the mesh, in the order in which they are first listed.
    pub cells: Vec<Cell>,
    /// Nodes at each cell's corners, in the order of [`CORNERS`].
    pub nodes: Vec<[u32; 8]>,
    /// Position of each node, in edges.
    pub position: Vec<[i32; 3]>,
}

impl Mesh {
    /// Builds the mesh of distinct `cells`.
    #[must_use]
    pub fn new(cells: Vec<Cell>) -> Self {
        let index: CellMap<u32> = cells.iter().copied().zip(0..).collect();
        let groups = CornerGroups::new();
        let mut numbers: HashMap<([i32; 3], u8), u32, RandomState> = HashMap::default();
        let mut position = Vec::new();
        let mut nodes = Vec::with_capacity(cells.len());
        for cell in &cells {
            // Look up the cell and its 26 neighbours once for all corners.
            let mut around = [false; 27];
            for (i, taken) in (0i32..).zip(&mut around) {
                *taken = i == 13 || index.contains_key(&cell.offset(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
            }
            nodes.push(CORNERS.map(|corner| {
                let mut mask = 0u8;
                for (bit, [x, y, z]) in CORNERS.iter().enumerate() {
                    let at = (corner[0] + x) + 3 * (corner[1] + y) + 9 * (corner[2] + z);
                    mask |= u8::from(around[at as usize]) << bit;
                }
                let own = CORNERS.iter().position(|c| (0..3).all(|k| c[k] == 1 - corner[k])).unwrap_or(0);
                let place = [cell.x + corner[0], cell.y + corner[1], cell.z + corner[2]];
                *numbers.entry((place, groups.group(mask, own))).or_insert_with(|| {
                    position.push(place);
                    position.len() as u32 - 1
                })
            }));
        }
        Self { cells, nodes, position }
    }
}

/// Groups of cells connected through faces at a corner, for each set of taken cells around it.
#[derive(Debug)]
struct CornerGroups {
    /// First cell of the group of each of the eight cells, for each set.
    first: Vec<[u8; 8]>,
}

impl CornerGroups {
    fn new() -> Self {
        let first = (0..=u8::MAX).map(|mask| {
            let mut first: [u8; 8] = std::array::from_fn(|i| i as u8);
            // The longest path around a corner has seven steps.
            for _ in 0..7 {
                for (a, b) in (0..8).flat_map(|a| [1, 2, 4].map(|bit| (a, a ^ bit))) {
                    if mask >> a & 1 == 1 && mask >> b & 1 == 1 {
                        first[a] = first[a].min(first[b]);
                    }
                }
            }
            first
        });
        Self { first: first.collect() }
    }

    fn group(&self, mask: u8, cell: usize) -> u8 {
        self.first[mask as usize][cell]
    }
}

/// Distinct cells that are connected through faces to a cell at the least y.
#[derive(Debug)]
pub struct Supported {
    /// Distinct supported cells, one layer across the longest axis after the other: neighbours are then near each other.
    /// The second share of a large structure begins at its far end, so that the shares end where they meet.
    pub cells: Vec<Cell>,
    /// Index of each entry in `cells`; `None` for an unsupported entry.
    pub index: Vec<Option<u32>>,
}

impl Supported {
    /// Finds the supported cells among `cells`, which may repeat.
    #[must_use]
    pub fn of(cells: &[Cell]) -> Self {
        let lowest = cells.iter().map(|cell| cell.y).min().unwrap_or(0);
        let mut entry: CellMap<u32> = CellMap::default();
        for (i, &cell) in (0..).zip(cells) {
            entry.entry(cell).or_insert(i);
        }
        let linked = linked_by_faces(cells, &entry, |cell| cell.y == lowest);
        let firsts = (0..cells.len()).filter(|&i| linked[i] && entry[&cells[i]] as usize == i);
        let mut firsts: Vec<usize> = firsts.collect();
        let axes = longest_first(firsts.iter().map(|&first| cells[first]));
        firsts.sort_unstable_by_key(|&first| axes.map(|axis| <[i32; 3]>::from(cells[first])[axis]));
        if let Some(half) = half(firsts.len()) {
            firsts[half..].reverse();
        }
        let mut number = vec![None; cells.len()];
        for (at, &first) in (0..).zip(&firsts) {
            number[first] = Some(at);
        }
        Self {
            cells: firsts.iter().map(|&first| cells[first]).collect(),
            index: cells.iter().map(|cell| number[entry[cell] as usize]).collect(),
        }
    }
}

/// Returns the axes, the one along which these cells extend farthest first.
fn longest_first(cells: impl Iterator<Item = Cell>) -> [usize; 3] {
    let (mut least, mut most) = ([i32::MAX; 3], [i32::MIN; 3]);
    for cell in cells {
        let place = <[i32; 3]>::from(cell);
        for k in 0..3 {
            least[k] = least[k].min(place[k]);
            most[k] = most[k].max(place[k]);
        }
    }
    let mut axes = [0, 1, 2];
    axes.sort_by_key(|&k| std::cmp::Reverse(i64::from(most[k]) - i64::from(least[k])));
    axes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_share_nodes_at_faces_only() {
        let mesh = |cells: &[[i32; 3]]| Mesh::new(cells.iter().map(|&[x, y, z]| Cell::new(x, y, z)).collect());
        assert_eq!(mesh(&[[0, 0, 0]]).position.len(), 8);
        assert_eq!(mesh(&[[0, 0, 0], [1, 0, 0]]).position.len(), 12);
        assert_eq!(mesh(&[[0, 0, 0], [1, 1, 0]]).position.len(), 16);
        assert_eq!(mesh(&[[0, 0, 0], [1, 1, 1]]).position.len(), 16);
        // A ring around an edge: each block is connected to the next.
        assert_eq!(mesh(&[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]).position.len(), 18);
        // An L: the two ends touch at an edge, and are connected there through the third block.
        assert_eq!(mesh(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]]).position.len(), 16);
    }

    #[test]
    fn what_floats_is_not_supported() {
        let cells = [[0, 0, 0], [0, 1, 0], [1, 2, 0], [0, 1, 0]].map(|[x, y, z]| Cell::new(x, y, z));
        let supported = Supported::of(&cells);
        assert_eq!(supported.cells, cells[..2]);
        assert_eq!(supported.index, [Some(0), Some(1), None, Some(1)]);
    }
}
