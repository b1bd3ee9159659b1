//! Neighbours within the kernel's reach, and the smoothing kernel.

use nalgebra::Vector3;

use crate::voxel::{Cell, CellMap};

/// Reach of the smoothing kernel in cells: neighbours are nearer than this (6 faces, 12 edges, 8 corners).
pub const REACH: f64 = 2.0;

/// The smoothing kernel at distance `r < REACH`: `W(r) = 15 / (pi h^6) (h - r)^3`.
#[must_use]
pub fn kernel(r: f64) -> f64 {
    15.0 / (std::f64::consts::PI * REACH.powi(6)) * (REACH - r).powi(3)
}

/// Gradient of the kernel along the reference vector `R = X_j - X_i`, `|R| > 0`.
#[must_use]
pub fn kernel_gradient(reference: &Vector3<f64>) -> Vector3<f64> {
    let r = reference.norm();
    reference * (-3.0 * 15.0 / (std::f64::consts::PI * REACH.powi(6)) * (REACH - r).powi(2) / r)
}

/// Directed neighbour lists of particles, one after another: those of particle `i` are `of[start[i]..start[i + 1]]`.
#[derive(Debug)]
pub struct Neighbours {
    /// Where each particle's neighbours begin; one longer than the particles.
    pub start: Vec<usize>,
    /// Indices of the neighbours, ascending for each particle.
    pub of: Vec<u32>,
}

impl Neighbours {
    /// Neighbours of each particle among `cells`. Particles in the same cell have no direction to each other and are
    /// left out.
    #[must_use]
    pub fn among(cells: &[Cell]) -> Self {
        let at = particles_by_cell(cells);
        let mut start = Vec::with_capacity(cells.len() + 1);
        let mut of = Vec::new();
        start.push(0);
        for cell in cells {
            let begin = of.len();
            for (dx, dy, dz) in offsets() {
                if let Some(particles) = at.get(&cell.offset(dx, dy, dz)) {
                    of.extend_from_slice(particles);
                }
            }
            of[begin..].sort_unstable();
            start.push(of.len());
        }
        Self { start, of }
    }

    /// Range of particle `i`'s neighbours in [`Neighbours::of`].
    #[must_use]
    pub fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.start[i]..self.start[i + 1]
    }
}

/// The particles in each cell, by their indices.
#[must_use]
pub fn particles_by_cell(cells: &[Cell]) -> CellMap<Vec<u32>> {
    let mut at: CellMap<Vec<u32>> = CellMap::default();
    for (i, &cell) in (0u32..).zip(cells) {
        at.entry(cell).or_default().push(i);
    }
    at
}

/// The 26 offsets nearer than [`REACH`].
fn offsets() -> impl Iterator<Item = (i32, i32, i32)> {
    let axis = || -1..=1;
    axis()
        .flat_map(move |x| axis().flat_map(move |y| axis().map(move |z| (x, y, z))))
        .filter(|&offset| offset != (0, 0, 0))
}
