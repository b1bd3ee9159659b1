//! Neighbours within the kernel's reach, and the smoothing kernel.

use nalgebra::Vector3;

/// Reach of the smoothing kernel in cells: neighbours are nearer than this (6 faces, 12 edges, 8 corners).
pub const REACH: f64 = 2.0;

/// Returns the smoothing kernel at distance `r < REACH`: `W(r) = 15 / (pi h^6) (h - r)^3`.
#[must_use]
pub fn kernel(r: f64) -> f64 {
    15.0 / (std::f64::consts::PI * REACH.powi(6)) * (REACH - r).powi(3)
}

/// Returns the gradient of the kernel along the reference vector `R = X_j - X_i`, `|R| > 0`.
#[must_use]
pub fn kernel_gradient(reference: &Vector3<f64>) -> Vector3<f64> {
    let r = reference.norm();
    reference * (-3.0 * 15.0 / (std::f64::consts::PI * REACH.powi(6)) * (REACH - r).powi(2) / r)
}

/// One of each pair of opposite offsets to a neighbour: 3 faces, 6 edges, 4 corners. The last non-zero component is 1,
/// so all of these neighbours lie ahead when cells are numbered row by row and layer by layer.
pub const DIRECTIONS: [[i32; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [-1, 1, 0],
    [1, 0, 1],
    [-1, 0, 1],
    [0, 1, 1],
    [0, -1, 1],
    [1, 1, 1],
    [-1, 1, 1],
    [1, -1, 1],
    [-1, -1, 1],
];
