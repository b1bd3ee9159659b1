//! Matrix-free equations of a mesh: forces on the nodes for displacements of the nodes.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::{SVector, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::element::{Element, UNKNOWNS};
use super::mesh::Mesh;
use crate::elasticity::lanes::Lanes;

/// Number of vectors of rows that are computed at the same time; with eight lanes, all rows.
const TOGETHER: usize = 3;

/// Equations of a mesh with an edge length and held nodes.
#[derive(Debug)]
pub struct System<'a> {
    /// Mesh of the structure.
    pub mesh: &'a Mesh,
    /// Element of each block.
    pub element: &'a Element,
    /// Edge of a block, m.
    pub edge_m: f64,
    /// Whether each node is held.
    pub is_held: Vec<bool>,
    /// Stiffness matrix of a block, column by column, N/m.
    columns: Vec<f64>,
    arch: Arch,
}

impl<'a> System<'a> {
    /// Sets up the equations of a mesh of blocks with edge `edge_m`. `is_held` receives each node's position, in edges.
    #[must_use]
    pub fn new(mesh: &'a Mesh, element: &'a Element, edge_m: f64, is_held: impl Fn(&[i32; 3]) -> bool) -> Self {
        let columns = element.stiffness.iter().map(|entry| entry * edge_m).collect();
        Self { mesh, element, edge_m, is_held: mesh.position.iter().map(is_held).collect(), columns, arch: Arch::new() }
    }

    /// Returns the number of unknowns, including those of held nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        3 * self.mesh.position.len()
    }

    /// Computes the forces on the nodes, N, for displacements, m; zero on held nodes.
    pub fn apply(&self, displacement: &[f64], force: &mut [f64]) {
        self.pull(displacement, force);
        self.release(force);
    }

    /// Computes the forces on the nodes, N, for displacements, m, those on held nodes too.
    pub fn pull(&self, displacement: &[f64], force: &mut [f64]) {
        force.fill(0.0);
        self.arch.dispatch(Apply { nodes: &self.mesh.nodes, columns: &self.columns, displacement, force });
    }

    /// Sets the components of held nodes to zero.
    pub fn release(&self, vector: &mut [f64]) {
        for (triple, is_held) in vector.chunks_exact_mut(3).zip(&self.is_held) {
            if *is_held {
                triple.fill(0.0);
            }
        }
    }

    /// Returns the forces on the nodes, N, from a weight of `weight_n` per block; zero on held nodes.
    #[must_use]
    pub fn weight(&self, weight_n: f64) -> Vec<f64> {
        let mut force = vec![0.0; self.len()];
        for nodes in &self.mesh.nodes {
            for &node in nodes {
                force[3 * node as usize + 1] -= weight_n / 8.0;
            }
        }
        self.release(&mut force);
        force
    }

    /// Returns the displacements of a block's corners.
    #[must_use]
    pub fn corners(&self, block: usize, displacement: &[f64]) -> SVector<f64, UNKNOWNS> {
        let triples = self.mesh.nodes[block].iter().flat_map(|&node| {
            let at = 3 * node as usize;
            displacement[at..at + 3].iter().copied()
        });
        SVector::from_iterator(triples)
    }
}

/// Returns the displacement of a block's centre, from those of its corners.
#[must_use]
pub fn centre(corners: &SVector<f64, UNKNOWNS>) -> [f64; 3] {
    let sum: Vector3<f64> = (0..8).map(|c| corners.fixed_rows::<3>(3 * c).into_owned()).sum();
    (sum / 8.0).into()
}

/// Operation that adds up the forces of all blocks.
struct Apply<'a> {
    nodes: &'a [[u32; 8]],
    columns: &'a [f64],
    displacement: &'a [f64],
    force: &'a mut [f64],
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Some((columns, _)) = self.columns.split_first_chunk::<{ UNKNOWNS * UNKNOWNS }>() else { return };
        for nodes in self.nodes {
            let mut corners = [0.0; UNKNOWNS];
            for (triple, &node) in corners.chunks_exact_mut(3).zip(nodes) {
                let at = 3 * node as usize;
                triple.copy_from_slice(&self.displacement[at..at + 3]);
            }
            let mut pulled = [0.0; UNKNOWNS];
            // Several rows at a time, with separate sums for even and odd columns: none waits for another.
            for first in (0..UNKNOWNS).step_by(TOGETHER * S::F64_LANES) {
                let mut sums = [[Lanes::splat(simd, 0.0); 2]; TOGETHER];
                for pair in 0..UNKNOWNS / 2 {
                    let (even, odd) = (2 * pair, 2 * pair + 1);
                    let moved = [Lanes::splat(simd, corners[even]), Lanes::splat(simd, corners[odd])];
                    for k in 0..TOGETHER {
                        let row = first + k * S::F64_LANES;
                        let entries = Lanes::load(simd, columns, UNKNOWNS * even + row);
                        sums[k][0] = entries.mul_add(moved[0], sums[k][0]);
                        let entries = Lanes::load(simd, columns, UNKNOWNS * odd + row);
                        sums[k][1] = entries.mul_add(moved[1], sums[k][1]);
                    }
                }
                for (k, [even, odd]) in sums.into_iter().enumerate() {
                    (even + odd).store(&mut pulled, first + k * S::F64_LANES);
                }
            }
            for (triple, &node) in pulled.chunks_exact(3).zip(nodes) {
                let at = 3 * node as usize;
                for (sum, part) in self.force[at..at + 3].iter_mut().zip(triple) {
                    *sum += part;
                }
            }
        }
    }
}
