//! Matrix-free equations of a mesh: forces on the nodes for displacements of the nodes.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::{SVector, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::element::{Element, UNKNOWNS};
use super::mesh::Mesh;
use super::modes::{Modes, add};
use super::pipeline::Pipeline;
use super::shares::{Corners, Shares};

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
    /// Stiffness of a block, N/m.
    modes: Modes,
    /// Blocks of the mesh as several cores share them.
    pub shares: Shares,
    arch: Arch,
}

impl<'a> System<'a> {
    /// Sets up the equations of a mesh of blocks with edge `edge_m`. `is_held` receives each node's position, in edges.
    #[must_use]
    pub fn new(mesh: &'a Mesh, element: &'a Element, edge_m: f64, is_held: impl Fn(&[i32; 3]) -> bool) -> Self {
        Self {
            mesh,
            element,
            edge_m,
            is_held: mesh.position.iter().map(is_held).collect(),
            modes: Modes::new(&(element.stiffness * edge_m)),
            shares: Shares::new(&mesh.nodes, mesh.position.len()),
            arch: Arch::new(),
        }
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
        self.arch.dispatch(Apply { blocks: &self.mesh.nodes, modes: &self.modes, displacement, force });
    }

    /// Returns what takes steps of smoothing through the structure.
    #[must_use]
    pub fn pipeline(&self) -> Pipeline<'_> {
        Pipeline { shares: &self.shares, modes: &self.modes, arch: self.arch }
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

/// Adds the forces of blocks.
struct Apply<'a> {
    blocks: &'a [Corners],
    modes: &'a Modes,
    displacement: &'a [f64],
    force: &'a mut [f64],
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        add(simd, self.blocks, self.modes, self.displacement, self.force, |node| 3 * node as usize);
    }
}
