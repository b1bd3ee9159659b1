//! Connectivity through faces, and in particular to the ground.

use super::cell::{Cell, CellMap};
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
