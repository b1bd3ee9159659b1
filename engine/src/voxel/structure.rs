//! The structure: the blocks that stand after a turn, in building order.

use std::sync::{Arc, OnceLock};

use super::cell::{Bounds, Cell, CellMap};
use super::palette::{MaterialId, Palette};

/// The blocks that stand after a turn, in building order.
///
/// A structure that is replayed from a log holds every cell once. A structure that is taken as given (a raw record) may
/// hold a cell several times; each entry then counts wherever a rule counts entries (`docs/rules.md#material`).
#[derive(Debug, Clone)]
pub struct Structure {
    palette: Arc<Palette>,
    cells: Vec<Cell>,
    materials: Vec<MaterialId>,
    /// Whether every cell is known to be listed once.
    is_distinct: bool,
    first_entry: OnceLock<CellMap<u32>>,
    /// For each second half of an object in two cells, the cell of the first; empty unless read as the game reads it.
    first_halves: Option<CellMap<Cell>>,
}

impl Structure {
    /// Creates a structure from entries in building order; the material ids refer to `palette`.
    #[must_use]
    pub fn new(palette: Arc<Palette>, entries: impl IntoIterator<Item = (Cell, MaterialId)>) -> Self {
        let (cells, materials) = entries.into_iter().unzip();
        Self { palette, cells, materials, is_distinct: false, first_entry: OnceLock::new(), first_halves: None }
    }

    /// Creates a structure from entries of which no two have the same cell.
    #[must_use]
    pub(super) fn of_distinct(palette: Arc<Palette>, entries: impl IntoIterator<Item = (Cell, MaterialId)>) -> Self {
        Self { is_distinct: true, ..Self::new(palette, entries) }
    }

    /// Returns whether every cell is known to be listed once.
    #[must_use]
    pub(super) const fn is_distinct(&self) -> bool {
        self.is_distinct
    }

    /// Gives the entries the names of another palette; `ids` has the new id of each old one.
    #[must_use]
    pub(super) fn renamed(mut self, palette: Arc<Palette>, ids: &[MaterialId]) -> Self {
        for id in &mut self.materials {
            *id = ids[*id as usize];
        }
        self.palette = palette;
        self
    }

    /// Marks the structure as read like the game reads it, with the first half of each object's second half.
    #[must_use]
    pub(super) fn with_second_halves(self, first_halves: CellMap<Cell>) -> Self {
        Self { first_halves: Some(first_halves), ..self }
    }

    /// Returns whether the structure was read as the game reads it (see [`super::reading`]).
    #[must_use]
    pub const fn is_read_as_game(&self) -> bool {
        self.first_halves.is_some()
    }

    /// Returns the first half of the object of which `cell` is the second half, such as the lower half of a door.
    #[must_use]
    pub fn other_half(&self, cell: Cell) -> Option<Cell> {
        self.first_halves.as_ref()?.get(&cell).copied()
    }

    /// Creates a structure from cells and material names in building order.
    #[must_use]
    pub fn from_named<'a>(entries: impl IntoIterator<Item = (Cell, &'a str)>) -> Self {
        let mut palette = Palette::new();
        let entries: Vec<_> = entries.into_iter().map(|(cell, name)| (cell, palette.intern(name))).collect();
        Self::new(Arc::new(palette), entries)
    }

    /// Returns the number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Returns whether the structure has no entries.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Returns the cells of the entries, in building order.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Returns the material ids of the entries, in building order.
    #[must_use]
    pub fn material_ids(&self) -> &[MaterialId] {
        &self.materials
    }

    /// Returns the palette that maps the material ids to names.
    #[must_use]
    pub fn palette(&self) -> &Palette {
        &self.palette
    }

    /// Returns the material name of the entry at `index`, or an empty string if there is no such entry.
    #[must_use]
    pub fn material(&self, index: usize) -> &str {
        self.materials.get(index).map_or("", |&id| self.palette.name(id))
    }

    /// Returns the cells and material ids of the entries, in building order.
    pub fn entries(&self) -> impl ExactSizeIterator<Item = (Cell, MaterialId)> + '_ {
        self.cells.iter().copied().zip(self.materials.iter().copied())
    }

    /// Returns the cells of the entries whose material satisfies `wanted`, in building order.
    #[must_use]
    pub fn cells_of(&self, wanted: impl Fn(&str) -> bool) -> Vec<Cell> {
        let mask = self.palette.mask(wanted);
        self.entries().filter(|(_, id)| mask[*id as usize]).map(|(cell, _)| cell).collect()
    }

    /// Returns the entries whose material satisfies `wanted`, in building order, read as this structure was.
    #[must_use]
    pub fn only(&self, wanted: impl Fn(&str) -> bool) -> Self {
        let mask = self.palette.mask(wanted);
        let entries = self.entries().filter(|(_, id)| mask[*id as usize]);
        let only = Self::new(Arc::clone(&self.palette), entries);
        Self { is_distinct: self.is_distinct, first_halves: self.first_halves.clone(), ..only }
    }

    /// Computes the bounds of all entries. Returns `None` if the structure is empty.
    #[must_use]
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(self.cells.iter().copied())
    }

    /// Returns the map from each cell to the index of its first entry. The map is built on first use.
    #[must_use]
    pub fn index(&self) -> &CellMap<u32> {
        self.first_entry.get_or_init(|| {
            let mut index = CellMap::with_capacity_and_hasher(self.cells.len(), foldhash::fast::RandomState::default());
            for (i, &cell) in (0u32..).zip(&self.cells) {
                index.entry(cell).or_insert(i);
            }
            index
        })
    }

    /// Returns whether a block stands at `cell`.
    #[must_use]
    pub fn contains(&self, cell: Cell) -> bool {
        self.index().contains_key(&cell)
    }

    /// Returns the number of distinct cells: less than [`Structure::len`] only if a cell is listed more than once.
    #[must_use]
    pub fn distinct_cells(&self) -> usize {
        if self.is_distinct { self.len() } else { self.index().len() }
    }
}
