//! Where a walker gets to on a terrain, step by step.

use super::{LADDER, Terrain};
use crate::voxel::Cell;

impl Terrain {
    /// Returns the index of a cell if a player can stand in every cell of the square of `width` by `width` cells, on its
    /// level, whose least x and z are there.
    fn stand_square(&self, feet: Cell, width: i32) -> Option<usize> {
        let index = self.index(feet)?;
        let [x, z] = [feet.x - self.min.x, feet.z - self.min.z];
        let is_inside = x + width <= self.size[0] && z + width <= self.size[2];
        (is_inside && self.stands_in_square(index, width)).then_some(index)
    }

    /// Returns whether a player can stand in every cell of a square that lies within the grid.
    fn stands_in_square(&self, index: usize, width: i32) -> bool {
        let stands = self.stands();
        let mut rows = (0..width).map(|dx| index + (dx * self.size[2]) as usize);
        rows.all(|row| stands[row..row + width as usize].iter().all(|stands| *stands))
    }

    /// Returns the squares of `width` by `width` cells that lie beside the build on natural ground, each as its cell of
    /// least x and z. `width` is at most the margin.
    #[must_use]
    pub fn around(&self, width: i32) -> Vec<Cell> {
        let ring = (0..self.size[0]).flat_map(|x| (0..self.size[2]).map(move |z| (x, z)));
        let is_outside =
            |at: &Cell| (0..width).all(|dx| (0..width).all(|dz| self.bounds.is_outside_in_plan(at.x + dx, at.z + dz)));
        ring.map(|(x, z)| self.min.offset(x, 0, z)).filter(is_outside).collect()
    }

    /// Finds all cells that a walker can reach from `starts` by steps to the four sides, each up or down by at most
    /// `step`. The walker occupies a square of `width` by `width` cells, whose cell of least x and z is its position.
    #[must_use]
    pub fn reached(&self, starts: impl IntoIterator<Item = Cell>, step: i32, width: i32) -> Vec<Cell> {
        let mut seen = vec![false; self.cells.len()];
        let mut reached: Vec<Cell> = Vec::new();
        for start in starts {
            if let Some(index) = self.stand_square(start, width)
                && !std::mem::replace(&mut seen[index], true)
            {
                reached.push(start);
            }
        }
        let mut next = 0;
        while let Some(&from) = reached.get(next) {
            next += 1;
            for up in [1, -1].map(|dy| from.offset(0, dy, 0)) {
                let rungs = if up.y > from.y { from } else { up };
                if step > 0
                    && self.has(rungs, LADDER)
                    && let Some(index) = self.stand_square(up, width)
                    && !std::mem::replace(&mut seen[index], true)
                {
                    reached.push(up);
                }
            }
            for side in from.side_neighbours() {
                let [x, z] = [side.x - self.min.x, side.z - self.min.z];
                if !(0..=self.size[0] - width).contains(&x) || !(0..=self.size[2] - width).contains(&z) {
                    continue;
                }
                for to in (-step..=step).map(|dy| side.offset(0, dy, 0)) {
                    let y = to.y - self.min.y;
                    if !(0..self.size[1]).contains(&y) {
                        continue;
                    }
                    let index = self.index_at([x, y, z]);
                    if seen[index] || !self.stands_in_square(index, width) {
                        continue;
                    }
                    // A step up needs head room above the cell it starts from, a step down above the cell it leads to.
                    let head = if to.y > from.y { from } else { to };
                    if to.y == from.y || !self.is_solid(head.offset(0, 2, 0)) {
                        seen[index] = true;
                        reached.push(to);
                    }
                }
            }
        }
        reached
    }
}
