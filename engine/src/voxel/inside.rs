//! Rooms in a terrain: enclosed air that one can enter through doors, its floor and its ceiling.

use std::cell::OnceCell;

use super::cell::{Cell, CellSet};
use super::structure::Structure;
use super::terrain::{Spaces, Terrain};

/// Least number of cells with standing room that make enclosed air a room, unless a check wants more.
pub const LEAST_FLOOR: u32 = 4;

/// A build on natural ground with the air around and inside it.
#[derive(Debug)]
pub struct Surroundings {
    /// The build on natural ground.
    pub terrain: Terrain,
    spaces: OnceCell<Spaces>,
    /// For each region of the air, whether one can enter it through doors.
    entered: OnceCell<Vec<bool>>,
    /// For each region of the air, whether one can walk to a floor in it from the ground around the build, by steps of at
    /// most 0 and of at most 1 block.
    walked_to: [OnceCell<Vec<bool>>; 2],
    /// Where a walker gets to from the ground around the build, by steps of at most 0 and of at most 1 block.
    walked: [OnceCell<Vec<Cell>>; 2],
}

impl Surroundings {
    /// Creates the surroundings of a build. Returns `None` if it is empty or too large for a terrain.
    #[must_use]
    pub fn of(structure: &Structure) -> Option<Self> {
        Some(Self {
            terrain: Terrain::of(structure)?,
            spaces: OnceCell::new(),
            entered: OnceCell::new(),
            walked_to: [const { OnceCell::new() }; 2],
            walked: [const { OnceCell::new() }; 2],
        })
    }

    /// Returns the air, divided into regions; computed when it is first asked for.
    pub fn spaces(&self) -> &Spaces {
        self.spaces.get_or_init(|| self.terrain.spaces())
    }

    /// Returns the indices of the enclosed regions with at least `min_floor_cells` cells to stand in that doors connect
    /// to the outside, directly or through other regions.
    #[must_use]
    pub fn rooms(&self, min_floor_cells: u32) -> Vec<usize> {
        let pieces = &self.spaces().pieces;
        let entered = self.entered.get_or_init(|| self.terrain.entered(self.spaces()));
        let is_room = |piece: &usize| entered[*piece] && pieces[*piece].floor_cells >= min_floor_cells;
        (1..pieces.len()).filter(is_room).collect()
    }

    /// Returns those of the [`rooms`](Self::rooms) to a floor of which one can walk from the ground around the build by
    /// steps of at most `max_step`, or all for `None`. Steps above 1 count as 1.
    #[must_use]
    pub fn rooms_within(&self, min_floor_cells: u32, max_step: Option<u32>) -> Vec<usize> {
        let mut rooms = self.rooms(min_floor_cells);
        if let Some(step) = max_step {
            let step = step.min(1);
            let walked_to = self.walked_to[step as usize].get_or_init(|| self.walked_to(step));
            rooms.retain(|room| walked_to[*room]);
        }
        rooms
    }

    /// Returns the share of doors in what stands beside the air of a region, over all its levels.
    #[must_use]
    pub fn door_share(&self, piece: usize) -> f64 {
        let beside = self.terrain.cells_of(self.spaces(), &[piece]).flat_map(Cell::side_neighbours);
        let sides: CellSet =
            beside.filter(|side| self.terrain.is_solid(*side) || self.terrain.is_doorway(*side)).collect();
        let doors = sides.iter().filter(|side| self.terrain.is_doorway(**side)).count();
        if sides.is_empty() { 0.0 } else { doors as f64 / sides.len() as f64 }
    }

    /// Returns where a walker gets to from the ground around the build by steps of at most `max_step`, in an order that
    /// depends on the build alone; computed when it is first asked for. Steps above 1 count as 1.
    pub fn walked(&self, max_step: u32) -> &[Cell] {
        let step = max_step.min(1);
        self.walked[step as usize].get_or_init(|| self.terrain.reached(self.terrain.around(1), step as i32, 1))
    }

    /// Returns for each region of the air whether one can walk to a floor in it, from the ground around the build.
    fn walked_to(&self, step: u32) -> Vec<bool> {
        let spaces = self.spaces();
        let mut walked_to = vec![false; spaces.pieces.len()];
        for feet in self.walked(step) {
            if let Some(piece) = self.terrain.piece_of(*feet, spaces)
                && !walked_to[piece]
            {
                walked_to[piece] = self.terrain.is_floor(*feet);
            }
        }
        walked_to
    }
}

impl Terrain {
    /// Returns for each region whether doors connect it to the outside, directly or through other regions.
    fn entered(&self, spaces: &Spaces) -> Vec<bool> {
        let mut beyond: Vec<Vec<usize>> = vec![Vec::new(); spaces.pieces.len()];
        for [one, other] in self.doors().iter().filter_map(|door| self.joins(*door, spaces)) {
            beyond[one].push(other);
            beyond[other].push(one);
        }
        // Search from outside through one door after another.
        let mut is_entered = vec![false; spaces.pieces.len()];
        let mut open = vec![0];
        while let Some(piece) = open.pop() {
            if !std::mem::replace(&mut is_entered[piece], true) {
                open.extend(&beyond[piece]);
            }
        }
        is_entered
    }

    /// Returns the cells of these regions, by height, then x, then z.
    pub fn cells_of<'a>(&'a self, spaces: &'a Spaces, pieces: &[usize]) -> impl Iterator<Item = Cell> + 'a {
        let mut is_wanted = vec![false; spaces.pieces.len()];
        for piece in pieces {
            is_wanted[*piece] = true;
        }
        self.cells_in(spaces, is_wanted)
    }

    /// Returns the level of the first block above a cell, or `None` if there is none.
    #[must_use]
    pub fn ceiling_above(&self, cell: Cell) -> Option<i32> {
        (cell.y + 1..=self.top()).find(|y| self.is_solid(Cell::new(cell.x, *y, cell.z)))
    }
}
