//! The structure: the ordered blocks that stand after a turn.

use std::sync::{Arc, OnceLock};

use super::cell::{Bounds, Cell, CellMap};
use super::palette::{MaterialId, Palette};

/// The ordered blocks that stand after a turn.
///
/// A structure replayed from a log holds every cell once. One taken as given (a raw record) may hold a cell
/// several times; each entry then counts where the rule counts entries (SPEC 3).
#[derive(Debug, Clone)]
pub struct Structure {
    palette: Arc<Palette>,
    cells: Vec<Cell>,
    materials: Vec<MaterialId>,
    first_entry: OnceLock<CellMap<u32>>,
}

impl Structure {
    /// The structure with these entries, in building order.
    #[must_use]
    pub fn new(palette: Arc<Palette>, entries: impl IntoIterator<Item = (Cell, MaterialId)>) -> Self {
        let (cells, materials) = entries.into_iter().unzip();
        Self { palette, cells, materials, first_entry: OnceLock::new() }
    }

    /// The structure with these named entries, in building order.
    #[must_use]
    pub fn from_named<'a>(entries: impl IntoIterator<Item = (Cell, &'a str)>) -> Self {
        let mut palette = Palette::new();
        let entries: Vec<_> = entries.into_iter().map(|(cell, name)| (cell, palette.intern(name))).collect();
        Self::new(Arc::new(palette), entries)
    }

    /// Number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether nothing stands.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Cells of the entries, in building order.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Material ids of the entries, in building order.
    #[must_use]
    pub fn material_ids(&self) -> &[MaterialId] {
        &self.materials
    }

    /// Names behind the material ids.
    #[must_use]
    pub fn palette(&self) -> &Palette {
        &self.palette
    }

    /// Material name of the entry at `index`.
    #[must_use]
    pub fn material(&self, index: usize) -> &str {
        self.materials.get(index).map_or("", |&id| self.palette.name(id))
    }

    /// Cells and material ids of the entries, in building order.
    pub fn entries(&self) -> impl ExactSizeIterator<Item = (Cell, MaterialId)> + '_ {
        self.cells.iter().copied().zip(self.materials.iter().copied())
    }

    /// Cells of the entries whose material satisfies `wanted`, in building order.
    #[must_use]
    pub fn cells_of(&self, wanted: impl Fn(&str) -> bool) -> Vec<Cell> {
        let mask = self.palette.mask(wanted);
        self.entries().filter(|(_, id)| mask[*id as usize]).map(|(cell, _)| cell).collect()
    }

    /// The box around all entries, or `None` where nothing stands.
    #[must_use]
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(self.cells.iter().copied())
    }

    /// From each cell that stands to the first of its entries. Built on first use.
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

    /// Whether a block stands at `cell`.
    #[must_use]
    pub fn contains(&self, cell: Cell) -> bool {
        self.index().contains_key(&cell)
    }

    /// Number of distinct cells: less than [`Structure::len`] only where a cell is listed more than once.
    #[must_use]
    pub fn distinct_cells(&self) -> usize {
        self.index().len()
    }
}
