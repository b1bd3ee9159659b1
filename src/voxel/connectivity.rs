//! Face connectivity to the ground.

use super::cell::Cell;
use super::structure::Structure;

/// Whether the ground holds a block at this cell up by itself (SPEC 1: the ground surface is `y <= 0`).
#[must_use]
pub const fn is_at_ground(cell: Cell) -> bool {
    cell.y <= 0
}

/// Cells that no chain of face neighbours links to a cell at `y <= 0`, in building order, each entry once.
#[must_use]
pub fn floating_cells(structure: &Structure) -> Vec<Cell> {
    let index = structure.index();
    let cells = structure.cells();
    let mut grounded = vec![false; cells.len()];
    let mut open: Vec<Cell> = Vec::new();
    for cell in cells.iter().copied().filter(|&cell| is_at_ground(cell)) {
        visit(cell, index, &mut grounded, &mut open);
    }
    while let Some(cell) = open.pop() {
        for next in cell.face_neighbours() {
            visit(next, index, &mut grounded, &mut open);
        }
    }
    cells.iter().copied().filter(|cell| index.get(cell).is_none_or(|&i| !grounded[i as usize])).collect()
}

fn visit(cell: Cell, index: &super::cell::CellMap<u32>, grounded: &mut [bool], open: &mut Vec<Cell>) {
    if let Some(&i) = index.get(&cell)
        && !grounded[i as usize]
    {
        grounded[i as usize] = true;
        open.push(cell);
    }
}
