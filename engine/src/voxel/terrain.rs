//! The world as one walks it: natural ground below, blocks as walls and floors, doors two high that open.
//!
//! Feet stand in a cell with something solid under it and two free cells, its own and the one above. Natural ground fills
//! all cells below y = 0. A terrain is a dense grid, so it is made of builds up to [`MAX_EXTENT`] only.

use super::blocks::{is_door, is_passable};
use super::cell::{Bounds, Cell};
use super::structure::Structure;

/// Greatest extent of a build along an axis, and greatest height, in blocks, of which a terrain is made.
pub const MAX_EXTENT: i64 = 128;

const SOLID: u8 = 1;
const DOOR: u8 = 2;
/// Cells around the build, so that one can walk round it.
const MARGIN: i32 = 2;
/// Cells above the build, so that one can stand on it.
const HEAD_ROOM: i32 = 3;

/// A build on natural ground.
#[derive(Debug)]
pub struct Terrain {
    bounds: Bounds,
    min: Cell,
    size: [i32; 3],
    cells: Vec<u8>,
    doors: Vec<Cell>,
}

/// A piece of air that walls, floors, roofs and closed doors part from the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Its first cell by height, then x, then z.
    pub first: Cell,
    /// Cells in it where feet can stand.
    pub floor_cells: u32,
}

/// The air, in pieces.
#[derive(Debug)]
pub struct Spaces {
    /// Per cell of the grid the number of its piece plus one; 0 for what is no air.
    label: Vec<u32>,
    /// The pieces; the first is outside.
    pub pieces: Vec<Space>,
}

impl Terrain {
    /// Of a build; none where nothing stands or it is too large.
    #[must_use]
    pub fn of(structure: &Structure) -> Option<Self> {
        let bounds = structure.bounds()?;
        // The grid begins at the ground, wherever the build does.
        if bounds.extent().iter().any(|extent| *extent >= MAX_EXTENT) || i64::from(bounds.max.y) >= MAX_EXTENT {
            return None;
        }
        let min = Cell::new(bounds.min.x - MARGIN, 0, bounds.min.z - MARGIN);
        let top = bounds.max.y.max(0) + HEAD_ROOM;
        let size = [bounds.max.x + MARGIN - min.x + 1, top + 1, bounds.max.z + MARGIN - min.z + 1];
        let mut terrain =
            Self { bounds, min, size, cells: vec![0; (size[0] * size[1] * size[2]) as usize], doors: Vec::new() };
        let doors = structure.palette().mask(is_door);
        let open = structure.palette().mask(is_passable);
        for (cell, id) in structure.entries().filter(|(cell, _)| cell.y >= 0) {
            if doors[id as usize] {
                terrain.doors.push(cell);
            } else if !open[id as usize] {
                terrain.mark(cell, SOLID);
            }
        }
        for door in terrain.doors.clone() {
            for half in [door, door.offset(0, 1, 0)] {
                if !terrain.is_solid(half) {
                    terrain.mark(half, DOOR);
                }
            }
        }
        Some(terrain)
    }

    /// The doors, in building order.
    #[must_use]
    pub fn doors(&self) -> &[Cell] {
        &self.doors
    }

    fn index(&self, cell: Cell) -> Option<usize> {
        let at = [cell.x - self.min.x, cell.y - self.min.y, cell.z - self.min.z];
        let is_inside = at.iter().zip(self.size).all(|(at, size)| (0..size).contains(at));
        is_inside.then(|| ((at[1] * self.size[0] + at[0]) * self.size[2] + at[2]) as usize)
    }

    fn cell(&self, index: usize) -> Cell {
        let (index, [sx, _, sz]) = (index as i32, self.size);
        self.min.offset(index / sz % sx, index / sz / sx, index % sz)
    }

    fn mark(&mut self, cell: Cell, what: u8) {
        if let Some(index) = self.index(cell) {
            self.cells[index] |= what;
        }
    }

    fn has(&self, cell: Cell, what: u8) -> bool {
        self.index(cell).is_some_and(|index| self.cells[index] & what != 0)
    }

    /// Whether the cell is filled, by a block or by natural ground.
    #[must_use]
    pub fn is_solid(&self, cell: Cell) -> bool {
        cell.y < 0 || self.has(cell, SOLID)
    }

    /// Whether feet can stand in the cell; doorways are walked through.
    #[must_use]
    pub fn can_stand(&self, feet: Cell) -> bool {
        self.index(feet).is_some()
            && self.is_solid(feet.offset(0, -1, 0))
            && !self.is_solid(feet)
            && !self.is_solid(feet.offset(0, 1, 0))
    }

    /// Whether a square of so many cells, with its least x and z at `feet`, can be stood in on one level.
    fn can_stand_square(&self, feet: Cell, width: i32) -> bool {
        (0..width).all(|dx| (0..width).all(|dz| self.can_stand(feet.offset(dx, 0, dz))))
    }

    /// Squares of so many cells, at most the margin, that lie beside the build on natural ground; by their least x and z.
    #[must_use]
    pub fn around(&self, width: i32) -> Vec<Cell> {
        let ring = (0..self.size[0]).flat_map(|x| (0..self.size[2]).map(move |z| (x, z)));
        let is_outside =
            |at: &Cell| (0..width).all(|dx| (0..width).all(|dz| self.bounds.is_outside_in_plan(at.x + dx, at.z + dz)));
        ring.map(|(x, z)| self.min.offset(x, 0, z)).filter(is_outside).collect()
    }

    /// All cells that feet reach from `starts` by steps to the sides, each up or down by at most `step`, as a square of
    /// `width` cells whose least x and z are meant.
    #[must_use]
    pub fn reached(&self, starts: impl IntoIterator<Item = Cell>, step: i32, width: i32) -> Vec<Cell> {
        let mut seen = vec![false; self.cells.len()];
        let mut reached: Vec<Cell> = Vec::new();
        for start in starts {
            if let Some(index) = self.index(start).filter(|_| self.can_stand_square(start, width))
                && !std::mem::replace(&mut seen[index], true)
            {
                reached.push(start);
            }
        }
        let mut next = 0;
        while let Some(&from) = reached.get(next) {
            next += 1;
            for side in from.side_neighbours() {
                for dy in -step..=step {
                    let to = side.offset(0, dy, 0);
                    let Some(index) = self.index(to) else { continue };
                    // One who steps up needs room above the head where one comes from, one who steps down where one goes.
                    let head = if dy > 0 { from } else { to };
                    let has_room = dy == 0 || !self.is_solid(head.offset(0, 2, 0));
                    if !seen[index] && has_room && self.can_stand_square(to, width) {
                        seen[index] = true;
                        reached.push(to);
                    }
                }
            }
        }
        reached
    }

    /// The highest block that one stands on who comes from the ground around the build, stepping one up or down at a time.
    #[must_use]
    pub fn highest_climbed(&self) -> Option<Cell> {
        let reached = self.reached(self.around(1), 1, 1);
        reached.into_iter().map(|feet| feet.offset(0, -1, 0)).max_by_key(|block| (block.y, *block))
    }

    /// The air in pieces: outside first, then what is enclosed, by first cells. A closed door closes both its cells; walls that
    /// touch in an upright edge alone leave a gap.
    #[must_use]
    pub fn spaces(&self) -> Spaces {
        let mut spaces = Spaces { label: vec![0; self.cells.len()], pieces: Vec::new() };
        // The first cell of the grid is in its margin, so what it belongs to is outside; all margins join there.
        for index in 0..self.cells.len() {
            if self.cells[index] == 0 && spaces.label[index] == 0 {
                let piece = self.fill(index, spaces.pieces.len() as u32 + 1, &mut spaces.label);
                spaces.pieces.push(piece);
            }
        }
        spaces
    }

    fn fill(&self, start: usize, number: u32, label: &mut [u32]) -> Space {
        let mut floor_cells = 0;
        label[start] = number;
        let mut open = vec![start];
        while let Some(index) = open.pop() {
            let cell = self.cell(index);
            floor_cells += u32::from(self.can_stand(cell));
            // Through faces, and on a level past upright edges too: a room needs its corners.
            let past_edges = [(1, 1), (1, -1), (-1, 1), (-1, -1)].map(|(dx, dz)| cell.offset(dx, 0, dz));
            for next in cell.face_neighbours().into_iter().chain(past_edges) {
                if let Some(next) = self.index(next)
                    && self.cells[next] == 0
                    && label[next] == 0
                {
                    label[next] = number;
                    open.push(next);
                }
            }
        }
        Space { first: self.cell(start), floor_cells }
    }

    /// Whether a cell is air inside, parted from the outside.
    #[must_use]
    pub fn is_enclosed(&self, cell: Cell, spaces: &Spaces) -> bool {
        // 0 is no air, 1 is outside.
        self.index(cell).is_some_and(|index| spaces.label[index] > 1)
    }

    /// The pieces of air that a door joins, one on each of two opposite sides where feet can stand; none where one cannot walk
    /// through it.
    #[must_use]
    pub fn joins(&self, door: Cell, spaces: &Spaces) -> Option<[usize; 2]> {
        let piece = |cell: Cell| {
            let index = self.index(cell).filter(|_| self.can_stand(cell))?;
            // Beside a double door stands its other wing; feet stand in it, but it is no piece of air.
            spaces.label[index].checked_sub(1).map(|piece| piece as usize)
        };
        let through = |dx: i32, dz: i32| Some([piece(door.offset(-dx, 0, -dz))?, piece(door.offset(dx, 0, dz))?]);
        through(1, 0).or_else(|| through(0, 1)).filter(|_| self.can_stand(door))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed hut of 5 by 5, walls three high, with a door and a roof.
    fn hut(change: impl Fn(Cell) -> bool) -> Structure {
        let mut blocks = Vec::new();
        for x in 0..5 {
            for z in 0..5 {
                for y in 0..3 {
                    let is_doorway = x == 2 && z == 0 && y < 2;
                    if (x % 4 == 0 || z % 4 == 0) && !is_doorway {
                        blocks.push((Cell::new(x, y, z), "stone"));
                    }
                }
                blocks.push((Cell::new(x, 3, z), "oak_planks"));
            }
        }
        blocks.push((Cell::new(2, 0, 0), "oak_door"));
        Structure::from_named(blocks.into_iter().filter(|(cell, _)| change(*cell)))
    }

    #[test]
    fn a_hut_has_one_room_behind_its_door() {
        let terrain = Terrain::of(&hut(|_| true)).unwrap();
        let spaces = terrain.spaces();
        assert_eq!(spaces.pieces.len(), 2);
        assert_eq!(spaces.pieces[1], Space { first: Cell::new(1, 0, 1), floor_cells: 9 });
        assert_eq!(terrain.joins(Cell::new(2, 0, 0), &spaces), Some([0, 1]));
    }

    #[test]
    fn a_hole_in_the_roof_a_missing_door_or_corner_opens_it() {
        for hole in [Cell::new(2, 3, 2), Cell::new(2, 0, 0), Cell::new(0, 1, 0)] {
            assert_eq!(Terrain::of(&hut(|cell| cell != hole)).unwrap().spaces().pieces.len(), 1, "{hole:?}");
        }
    }

    #[test]
    fn one_walks_in_and_cannot_climb_the_walls() {
        let terrain = Terrain::of(&hut(|_| true)).unwrap();
        let reached = terrain.reached([Cell::new(-1, 0, 2)], 1, 1);
        assert!(reached.contains(&Cell::new(2, 0, 2)));
        assert_eq!(terrain.highest_climbed().unwrap().y, -1);
        let wide = terrain.reached([Cell::new(-2, 0, 2)], 0, 2);
        assert!(!wide.contains(&Cell::new(2, 0, 2)), "the door is one wide");
    }

    #[test]
    fn steps_are_climbed_where_there_is_head_room() {
        let steps = |ceiling: Option<Cell>| {
            let steps = (0..4).flat_map(|i| (0..=i).map(move |y| Cell::new(i, y, 0)));
            Structure::from_named(steps.chain(ceiling).map(|cell| (cell, "stone")))
        };
        assert_eq!(Terrain::of(&steps(None)).unwrap().highest_climbed(), Some(Cell::new(3, 3, 0)));
        let low = Some(Cell::new(1, 4, 0));
        assert_eq!(Terrain::of(&steps(low)).unwrap().highest_climbed(), Some(Cell::new(1, 1, 0)));
    }

    #[test]
    fn what_is_too_large_is_no_terrain() {
        assert!(Terrain::of(&Structure::from_named([])).is_none());
        let far = [Cell::new(0, 0, 0), Cell::new(30_000_000, 0, 0)];
        assert!(Terrain::of(&Structure::from_named(far.map(|cell| (cell, "stone")))).is_none());
    }
}
