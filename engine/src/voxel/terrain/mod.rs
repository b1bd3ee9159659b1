//! The world as a walking player experiences it: natural ground, blocks as walls and floors, and doors two cells high.
//!
//! A player can stand in a cell if the cell below it is solid, and the cell itself and the one above it are free.
//! Natural ground fills all cells below y = 0. A terrain is a dense grid, so the extent of a build is limited to
//! [`MAX_EXTENT`].

mod walking;

use std::cell::OnceCell;
use std::ops::Range;

use super::air_runs::AirRuns;
use super::blocks::{is_climbable, is_door, is_passable, is_thin};
use super::cell::{Bounds, Cell};
use super::structure::Structure;

/// Greatest extent of a build along an axis, and greatest height, in blocks, for which a terrain can be created.
pub const MAX_EXTENT: i64 = 128;

const SOLID: u8 = 1;
const DOOR: u8 = 2;
const LADDER: u8 = 4;
/// Number of free cells around the build, so that a player can walk around it.
const MARGIN: i32 = 2;
/// Number of free cells above the build, so that a player can stand on it.
const HEAD_ROOM: i32 = 3;

/// Index of the region outside.
const OUTSIDE: usize = 0;

/// A build on natural ground.
#[derive(Debug)]
pub struct Terrain {
    bounds: Bounds,
    min: Cell,
    size: [i32; 3],
    cells: Vec<u8>,
    /// For each row along z, what its cells have between them.
    rows: Vec<u8>,
    doors: Vec<Cell>,
    /// For each cell, whether a player can stand in it; computed when it is first asked for.
    stands: OnceCell<Vec<bool>>,
}

/// A region of air that walls, floors, roofs and closed doors separate from the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// First cell of the region, by height, then x, then z.
    pub first: Cell,
    /// Number of cells of the region in which a player can stand.
    pub floor_cells: u32,
}

/// The air around and inside a build, divided into regions.
#[derive(Debug)]
pub struct Spaces {
    runs: AirRuns,
    /// For each run of air, the index of its region.
    region: Vec<u32>,
    /// The regions; the first one is the outside.
    pub pieces: Vec<Space>,
}

impl Spaces {
    /// Returns the index of the region that a cell of the grid belongs to; none if the cell is not air.
    fn piece_at(&self, index: usize) -> Option<usize> {
        self.runs.at(index).map(|run| self.region[run] as usize)
    }
}

impl Terrain {
    /// Creates the terrain of a build. Returns `None` if the structure is empty or too large.
    #[must_use]
    pub fn of(structure: &Structure) -> Option<Self> {
        let bounds = structure.bounds()?;
        // The grid always begins at ground level, even if the build does not.
        if bounds.extent().iter().any(|extent| *extent >= MAX_EXTENT) || i64::from(bounds.max.y) >= MAX_EXTENT {
            return None;
        }
        let min = Cell::new(bounds.min.x - MARGIN, 0, bounds.min.z - MARGIN);
        let top = bounds.max.y.max(0) + HEAD_ROOM;
        let size = [bounds.max.x + MARGIN - min.x + 1, top + 1, bounds.max.z + MARGIN - min.z + 1];
        let cells = vec![0; (size[0] * size[1] * size[2]) as usize];
        let rows = vec![0; (size[0] * size[1]) as usize];
        let mut terrain = Self { bounds, min, size, cells, rows, doors: Vec::new(), stands: OnceCell::new() };
        let doors = structure.palette().mask(is_door);
        // As listed, a carpet is a full block and a ladder no way up.
        let is_game = structure.is_read_as_game();
        let climbable = structure.palette().mask(|name| is_game && is_climbable(name));
        let open =
            structure.palette().mask(|name| is_passable(name) || is_game && (is_thin(name) || is_climbable(name)));
        for (cell, id) in structure.entries().filter(|(cell, _)| cell.y >= 0) {
            if climbable[id as usize] {
                terrain.mark(cell, LADDER);
            }
            if doors[id as usize] {
                if structure.other_half(cell).is_none() {
                    terrain.doors.push(cell);
                }
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

    /// Returns the cells of the doors, in building order.
    #[must_use]
    pub fn doors(&self) -> &[Cell] {
        &self.doors
    }

    fn index(&self, cell: Cell) -> Option<usize> {
        let at = [cell.x - self.min.x, cell.y - self.min.y, cell.z - self.min.z];
        let is_inside = at.iter().zip(self.size).all(|(at, size)| (0..size).contains(at));
        is_inside.then(|| self.index_at(at))
    }

    /// Returns the index of the cell that lies so far from the least cell of the grid, along x, y and z.
    const fn index_at(&self, [x, y, z]: [i32; 3]) -> usize {
        ((y * self.size[0] + x) * self.size[2] + z) as usize
    }

    fn cell(&self, index: usize) -> Cell {
        let (index, [sx, _, sz]) = (index as i32, self.size);
        self.min.offset(index / sz % sx, index / sz / sx, index % sz)
    }

    fn mark(&mut self, cell: Cell, what: u8) {
        if let Some(index) = self.index(cell) {
            self.cells[index] |= what;
            self.rows[index / self.size[2] as usize] |= what;
        }
    }

    fn has(&self, cell: Cell, what: u8) -> bool {
        self.index(cell).is_some_and(|index| self.cells[index] & what != 0)
    }

    /// Returns whether a block or natural ground fills the cell.
    #[must_use]
    pub fn is_solid(&self, cell: Cell) -> bool {
        cell.y < 0 || self.has(cell, SOLID)
    }

    /// Returns whether a half of a door fills the cell.
    pub(super) fn is_doorway(&self, cell: Cell) -> bool {
        self.has(cell, DOOR)
    }

    /// Returns whether a player can stand in the cell. Doors do not block the way.
    #[must_use]
    pub fn can_stand(&self, feet: Cell) -> bool {
        self.index(feet).is_some_and(|index| self.stands()[index])
    }

    /// Returns for each cell of the grid whether a player can stand in it.
    fn stands(&self) -> &[bool] {
        self.stands.get_or_init(|| {
            let mut stands = vec![false; self.cells.len()];
            let length = self.size[2] as usize;
            let (ground, sky) = (vec![SOLID; length], vec![0; length]);
            for (row, stands) in stands.chunks_exact_mut(length).enumerate() {
                let [below, above] = [self.row_below(row), self.row_above(row)];
                if below.is_some_and(|below| self.rows[below] & (SOLID | LADDER) == 0) && self.rows[row] & LADDER == 0 {
                    continue;
                }
                let cells = |row: usize| &self.cells[row * length..(row + 1) * length];
                let around = below.map_or(&ground[..], cells).iter().zip(above.map_or(&sky[..], cells));
                for ((stands, own), (below, above)) in stands.iter_mut().zip(cells(row)).zip(around) {
                    *stands = (below & (SOLID | LADDER) | own & LADDER) != 0 && (own | above) & SOLID == 0;
                }
            }
            stands
        })
    }

    fn row_below(&self, row: usize) -> Option<usize> {
        row.checked_sub(self.size[0] as usize)
    }

    fn row_above(&self, row: usize) -> Option<usize> {
        Some(row + self.size[0] as usize).filter(|above| *above < self.rows.len())
    }

    /// Returns the number of cells of a level.
    const fn level(&self) -> usize {
        (self.size[0] * self.size[2]) as usize
    }

    /// Returns whether a player can stand in the cell on a block or on natural ground, and not on the rungs of a
    /// ladder.
    #[must_use]
    pub fn is_floor(&self, feet: Cell) -> bool {
        self.can_stand(feet) && self.is_solid(feet.offset(0, -1, 0)) && !self.has(feet, LADDER)
    }

    /// Divides the air into regions: the outside first, then the enclosed regions in the order of their first cells. A
    /// door is closed and blocks both its cells. Walls that touch only along a vertical edge leave a gap.
    #[must_use]
    pub fn spaces(&self) -> Spaces {
        let is_free = |row: usize| self.rows[row] & (SOLID | DOOR) == 0;
        let runs = AirRuns::of(self.size, is_free, |index| self.cells[index] & (SOLID | DOOR) == 0);
        let region = runs.regions();
        // The first cell of the grid lies in the margin, so its region is the outside, which includes the whole margin.
        let mut pieces: Vec<Space> = Vec::new();
        for (run, region) in runs.all().iter().zip(&region) {
            let floor_cells = self.floor_cells(run.clone());
            match pieces.get_mut(*region as usize) {
                Some(piece) => piece.floor_cells += floor_cells,
                None => pieces.push(Space { first: self.cell(run.start), floor_cells }),
            }
        }
        Spaces { runs, region, pieces }
    }

    /// Counts the cells of a run of air along z for which [`Self::is_floor`] holds.
    fn floor_cells(&self, run: Range<usize>) -> u32 {
        let row = run.start / self.size[2] as usize;
        if self.row_below(row).is_some_and(|below| self.rows[below] & SOLID == 0) {
            return 0;
        }
        let level = self.level();
        let is_solid = |index: Option<usize>| index.and_then(|at| self.cells.get(at)).is_some_and(|at| at & SOLID != 0);
        let is_floor = |index: &usize| {
            (*index < level || is_solid(index.checked_sub(level)))
                && self.cells[*index] & LADDER == 0
                && !is_solid(index.checked_add(level))
        };
        run.filter(is_floor).count() as u32
    }

    /// Returns the cells of air of the regions for which `is_wanted` holds at their index, by height, then x, then z.
    pub(super) fn cells_in<'a>(&'a self, spaces: &'a Spaces, is_wanted: Vec<bool>) -> impl Iterator<Item = Cell> + 'a {
        let own = spaces.runs.all().iter().zip(&spaces.region).filter(move |(_, piece)| is_wanted[**piece as usize]);
        own.flat_map(|(run, _)| run.clone().map(|index| self.cell(index)))
    }

    /// Returns the greatest y of the grid.
    pub(super) fn top(&self) -> i32 {
        self.min.y + self.size[1] - 1
    }

    /// Returns the index of the region that a cell belongs to, or `None` if it is no air or lies outside the grid.
    pub(super) fn piece_of(&self, cell: Cell, spaces: &Spaces) -> Option<usize> {
        self.index(cell).and_then(|index| spaces.piece_at(index))
    }

    /// Returns whether the cell is air that is separated from the outside.
    #[must_use]
    pub fn is_enclosed(&self, cell: Cell, spaces: &Spaces) -> bool {
        self.piece_of(cell, spaces).is_some_and(|piece| piece != OUTSIDE)
    }

    /// Returns the indices of the two regions that a door connects, one on each of two opposite sides in which a player
    /// can stand. Returns `None` if a player cannot walk through the door.
    #[must_use]
    pub fn joins(&self, door: Cell, spaces: &Spaces) -> Option<[usize; 2]> {
        let piece = |cell: Cell| {
            let index = self.index(cell).filter(|_| self.can_stand(cell))?;
            // The other wing of a double door is a cell in which a player can stand, but it belongs to no region.
            spaces.piece_at(index)
        };
        let through = |dx: i32, dz: i32| Some([piece(door.offset(-dx, 0, -dz))?, piece(door.offset(dx, 0, dz))?]);
        through(1, 0).or_else(|| through(0, 1)).filter(|_| self.can_stand(door))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Builds a closed hut of 5 by 5 blocks with walls three blocks high, a door and a roof.
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

    /// The greatest y at which a walker stands who comes from the ground around the build.
    fn highest_walked(terrain: &Terrain) -> i32 {
        terrain.reached(terrain.around(1), 1, 1).into_iter().map(|feet| feet.y).max().unwrap()
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
        assert_eq!(highest_walked(&terrain), 0);
        let wide = terrain.reached([Cell::new(-2, 0, 2)], 0, 2);
        assert!(!wide.contains(&Cell::new(2, 0, 2)), "the door is one wide");
    }

    #[test]
    fn steps_are_climbed_where_there_is_head_room() {
        let steps = |ceiling: Option<Cell>| {
            let steps = (0..4).flat_map(|i| (0..=i).map(move |y| Cell::new(i, y, 0)));
            Structure::from_named(steps.chain(ceiling).map(|cell| (cell, "stone")))
        };
        assert_eq!(highest_walked(&Terrain::of(&steps(None)).unwrap()), 4);
        let low = Some(Cell::new(1, 4, 0));
        assert_eq!(highest_walked(&Terrain::of(&steps(low)).unwrap()), 2);
    }

    #[test]
    fn what_is_too_large_is_no_terrain() {
        assert!(Terrain::of(&Structure::from_named([])).is_none());
        let far = [Cell::new(0, 0, 0), Cell::new(30_000_000, 0, 0)];
        assert!(Terrain::of(&Structure::from_named(far.map(|cell| (cell, "stone")))).is_none());
    }
}
