//! Samples of cells that show what a check or a method found.

use serde::{Deserialize, Serialize};

use crate::voxel::Cell;

/// Greatest number of witness cells that a finding lists; it counts all of them.
pub const MAX_WITNESSES: usize = 20;

/// Sample of cells of one kind, with their total number.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CellSample {
    /// Total number of cells; a cell listed twice counts twice.
    pub total: u64,
    /// First cells, as `[x, y, z]`; at most 20.
    #[schema(value_type = Vec<[i32; 3]>)]
    pub cells: Vec<Cell>,
}

impl CellSample {
    /// Samples the cells of the entries with these indices.
    #[must_use]
    pub fn of(cells: &[Cell], entries: &[u32]) -> Self {
        let first = entries.iter().take(MAX_WITNESSES).map(|&entry| cells[entry as usize]);
        Self { total: entries.len() as u64, cells: first.collect() }
    }
}
