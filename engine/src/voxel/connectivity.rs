//! Connectivity through faces, and in particular to the ground.

use super::cell::{Bounds, Cell, CellMap};
use super::structure::Structure;

/// Returns whether the ground itself supports a block at this cell (`docs/rules.md#words`: the ground surface is `y <=
/// 0`).
#[must_use]
pub const fn is_at_ground(cell: Cell) -> bool {
    cell.y <= 0
}

/// Returns the cells that no chain of face neighbours links to a cell at `y <= 0`, in building order, once per entry.
#[must_use]
pub fn floating_cells(structure: &Structure) -> Vec<Cell> {
    let bounds = structure.bounds().filter(|bounds| Grid::suits(bounds, structure.len()));
    match bounds {
        Some(bounds) => Grid::of(bounds, structure.cells()).floating(structure.cells()),
        None => floating_in_map(structure),
    }
}

/// The cells of a build as a dense grid with an empty margin, for builds that fill a fair part of their box.
struct Grid {
    min: Cell,
    /// Distance in memory between neighbours along x, y and z.
    stride: [usize; 3],
    cells: Vec<u8>,
}

impl Grid {
    const EMPTY: u8 = 0;
    const STANDS: u8 = 1;
    const LINKED: u8 = 2;

    /// Returns whether the box is small beside the number of blocks: larger grids would take more than they save.
    fn suits(bounds: &Bounds, blocks: usize) -> bool {
        let cells = bounds.extent().map(|extent| extent as u128 + 3).iter().product::<u128>();
        cells <= 64 * blocks as u128 + 4_096
    }

    fn of(bounds: Bounds, blocks: &[Cell]) -> Self {
        let [x, y, z] = bounds.extent().map(|extent| extent as usize + 3);
        let stride = [z, x * z, 1];
        let mut grid = Self { min: bounds.min.offset(-1, -1, -1), stride, cells: vec![Self::EMPTY; x * y * z] };
        for cell in blocks {
            let at = grid.at(*cell);
            grid.cells[at] = Self::STANDS;
        }
        grid
    }

    fn at(&self, cell: Cell) -> usize {
        let from = [cell.x - self.min.x, cell.y - self.min.y, cell.z - self.min.z];
        from.iter().zip(self.stride).map(|(from, stride)| *from as usize * stride).sum()
    }

    fn floating(mut self, blocks: &[Cell]) -> Vec<Cell> {
        let mut open = Vec::with_capacity(blocks.len());
        for cell in blocks.iter().filter(|cell| is_at_ground(**cell)) {
            let at = self.at(*cell);
            self.link(at, &mut open);
        }
        while let Some(at) = open.pop() {
            // The margin keeps every neighbour within the grid.
            for stride in self.stride {
                self.link(at - stride, &mut open);
                self.link(at + stride, &mut open);
            }
        }
        blocks.iter().copied().filter(|cell| self.cells[self.at(*cell)] != Self::LINKED).collect()
    }

    fn link(&mut self, at: usize, open: &mut Vec<usize>) {
        if self.cells[at] == Self::STANDS {
            self.cells[at] = Self::LINKED;
            open.push(at);
        }
    }
}

fn floating_in_map(structure: &Structure) -> Vec<Cell> {
    let index = structure.index();
    let cells = structure.cells();
    let grounded = linked_by_faces(cells, index, is_at_ground);
    cells.iter().copied().filter(|cell| index.get(cell).is_none_or(|&i| !grounded[i as usize])).collect()
}

/// Computes, for each entry in `index`, whether a chain of face neighbours links it to a cell where `is_start` holds.
#[must_use]
pub fn linked_by_faces(cells: &[Cell], index: &CellMap<u32>, is_start: impl Fn(Cell) -> bool) -> Vec<bool> {
    let mut linked = vec![false; cells.len()];
    let mut open: Vec<Cell> = Vec::new();
    for cell in cells.iter().copied().filter(|&cell| is_start(cell)) {
        visit(cell, index, &mut linked, &mut open);
    }
    while let Some(cell) = open.pop() {
        for next in cell.face_neighbours() {
            visit(next, index, &mut linked, &mut open);
        }
    }
    linked
}

fn visit(cell: Cell, index: &CellMap<u32>, linked: &mut [bool], open: &mut Vec<Cell>) {
    if let Some(&i) = index.get(&cell)
        && !linked[i as usize]
    {
        linked[i as usize] = true;
        open.push(cell);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_grid_finds_what_the_map_finds(cells in prop::collection::vec((-3..3i32, -2..5i32, -3..3i32), 1..90)) {
            let cells = cells.into_iter().map(|(x, y, z)| (Cell::new(x, y, z), "stone"));
            let structure = Structure::from_named(cells);
            prop_assert!(Grid::suits(&structure.bounds().unwrap(), structure.len()));
            prop_assert_eq!(floating_cells(&structure), floating_in_map(&structure));
        }
    }

    #[test]
    fn blocks_far_apart_take_no_grid() {
        let far = [Cell::new(-30_000_000, 0, 0), Cell::new(30_000_000, 2_000, 30_000_000)];
        let structure = Structure::from_named(far.map(|cell| (cell, "stone")));
        assert!(!Grid::suits(&structure.bounds().unwrap(), 100_000));
        assert_eq!(floating_cells(&structure), far[1..]);
    }
}
