//! The building site, which places each block once, in order, along paths without wasted movement.

use crate::voxel::{BlockLog, Cell, CellSet, Event};

/// A build in progress.
#[derive(Debug, Default)]
pub struct Site {
    log: BlockLog,
    standing: CellSet,
}

/// A closed range of coordinates.
pub type Span = std::ops::RangeInclusive<i32>;

impl Site {
    /// Begins the next turn.
    pub fn begin_turn(&mut self) {
        self.log.turns.push(Vec::new());
    }

    /// Places a block, unless the cell already holds one.
    pub fn place(&mut self, cell: Cell, material: &str) {
        if self.standing.insert(cell) {
            self.log.place(cell, material);
        }
    }

    /// Removes every block for which `is_unwanted` holds, in reverse order of placement.
    pub fn remove(&mut self, is_unwanted: impl Fn(Cell) -> bool) {
        let placed = self.log.turns.iter().flatten().map(Event::cell);
        let mut unwanted: Vec<Cell> =
            placed.filter(|cell| self.standing.contains(cell) && is_unwanted(*cell)).collect();
        unwanted.reverse();
        for cell in unwanted {
            if self.standing.remove(&cell) {
                self.log.remove(cell);
            }
        }
    }

    /// Fills a box layer by layer, back and forth, so that each block touches the one before it.
    pub fn fill(&mut self, xs: &Span, ys: &Span, zs: &Span, material: &str) {
        let (mut x_back, mut z_back) = (false, false);
        for y in ys.clone() {
            for x in path(xs, x_back) {
                for z in path(zs, z_back) {
                    self.place(Cell::new(x, y, z), material);
                }
                z_back = !z_back;
            }
            x_back = !x_back;
        }
    }

    /// Lays a ring of walls, level by level, walking around it. Leaves out the cells for which `is_open` holds.
    pub fn ring(&mut self, xs: &Span, ys: &Span, zs: &Span, material: &str, is_open: &dyn Fn(Cell) -> bool) {
        let (x0, x1, z0, z1) = (*xs.start(), *xs.end(), *zs.start(), *zs.end());
        for y in ys.clone() {
            let front = (x0..=x1).map(|x| (x, z0));
            let right = (z0..=z1).map(|z| (x1, z));
            let back = (x0..=x1).rev().map(|x| (x, z1));
            let left = (z0..=z1).rev().map(|z| (x0, z));
            for (x, z) in front.chain(right).chain(back).chain(left) {
                let cell = Cell::new(x, y, z);
                if !is_open(cell) {
                    self.place(cell, material);
                }
            }
        }
    }

    /// Returns the log of everything placed and removed.
    #[must_use]
    pub fn into_log(self) -> BlockLog {
        self.log
    }
}

fn path(span: &Span, back: bool) -> Vec<i32> {
    let mut cells: Vec<i32> = span.clone().collect();
    if back {
        cells.reverse();
    }
    cells
}
