//! The particles of a simulation: their layout, and the quantities that stay constant over all steps.

use nalgebra::{Matrix3, Vector3};

use super::fields::Fields;
use super::stencil::Weights;
use crate::elasticity::lattice::Lattice;
use crate::elasticity::neighbours::{DIRECTIONS, kernel_gradient};
use crate::elasticity::small_matrix::{Flatness, flatness, inverse_or_pseudo_inverse};
use crate::voxel::Cell;

/// Entry of the list of cells.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Index of the particle in a field; `None` for a particle without neighbours.
    pub place: Option<usize>,
    /// Whether the particle is held, because it is at the least y.
    pub is_held: bool,
}

/// Quantities that stay constant over all steps.
#[derive(Debug)]
pub struct Particles {
    /// Layout of the particles in fields.
    pub lattice: Lattice,
    /// Weights of the kernel.
    pub weights: Weights,
    /// `sum_j grad W_ij`.
    pub gradient_sum: Fields<3>,
    /// `A^-1`: xx, yy, zz, xy, xz, yz.
    pub moment_inverse: Fields<6>,
    /// `A A^-1` in the same order: the deformation gradient at rest, the identity unless A is singular.
    pub at_rest: Fields<6>,
    /// 1 where there is a particle, otherwise 0.
    pub presence: Fields<1>,
    /// Positions at rest, relative to the least corner.
    pub rest: Fields<3>,
    /// 1 where there is a particle that is not held, otherwise 0.
    pub is_free: Fields<1>,
    /// Number of particles in each cell, if any share a cell.
    pub multiplicity: Option<Fields<1>>,
    /// Entries of the given list of cells.
    pub entries: Vec<Entry>,
    /// Whether every particle with neighbours is held.
    pub are_all_held: bool,
    /// Entries whose moment matrix A is singular.
    pub singular_moment: Vec<u32>,
    /// Whether some neighbourhood lies in a plane or line that is not along the axes.
    pub is_sloped: bool,
    /// Number of entries that share their cell with an earlier entry.
    pub repeated_cells: usize,
}

impl Particles {
    /// Creates particles at the centres of `cells`.
    #[must_use]
    pub fn new(cells: &[Cell]) -> Self {
        let repeated_cells = repeated(cells);
        let lattice = Lattice::of(cells);
        let lowest = cells.iter().map(|cell| cell.y).min().unwrap_or(0);
        let entry = |(cell, &place): (&Cell, &Option<usize>)| Entry { place, is_held: cell.y == lowest };
        let entries: Vec<Entry> = cells.iter().zip(&lattice.slot).map(entry).collect();
        let len = lattice.len;
        let mut particles = Self {
            weights: Weights::new(),
            gradient_sum: Fields::zero(len),
            moment_inverse: Fields::zero(len),
            at_rest: Fields::zero(len),
            presence: Fields::zero(len),
            rest: Fields::zero(len),
            is_free: Fields::zero(len),
            multiplicity: None,
            are_all_held: entries.iter().all(|entry| entry.is_held || entry.place.is_none()),
            entries,
            singular_moment: Vec::new(),
            is_sloped: false,
            repeated_cells,
            lattice,
        };
        let mut count = Fields::zero(len);
        let least = [0, 1, 2].map(|k| cells.iter().map(|cell| <[i32; 3]>::from(*cell)[k]).min().unwrap_or(0));
        for (cell, Entry { place, is_held }) in cells.iter().zip(&particles.entries) {
            let Some(place) = *place else { continue };
            let rest = particles.lattice.axes.map(|axis| f64::from(<[i32; 3]>::from(*cell)[axis] - least[axis]));
            particles.rest.set(place, rest);
            count.set(place, [count.at(place)[0] + 1.0]);
            particles.presence.set(place, [1.0]);
            particles.is_free.set(place, [if *is_held { 0.0 } else { 1.0 }]);
        }
        let is_free = &particles.is_free;
        particles.lattice.hold(|place| is_free.at(place)[0] > 0.0);
        particles.measure(&count);
        particles.multiplicity = (repeated_cells > 0).then_some(count);
        particles
    }

    /// Computes the sums over the neighbours of each particle.
    fn measure(&mut self, count: &Fields<1>) {
        let gradients = DIRECTIONS.map(|direction| kernel_gradient(&Vector3::from(direction.map(f64::from))));
        let mut is_singular = vec![None; self.lattice.len];
        for (entry, Entry { place, .. }) in (0u32..).zip(&self.entries) {
            let Some(place) = *place else {
                self.singular_moment.push(entry);
                continue;
            };
            if is_singular[place].is_none() {
                let block = self.lattice.block_at(place);
                let mut moment = Matrix3::zeros();
                let mut sum = Vector3::zeros();
                for (d, gradient) in gradients.iter().enumerate() {
                    let reference = Vector3::from(DIRECTIONS[d].map(f64::from));
                    let lane = place - block.slot;
                    let ahead = count.at(block.ahead[d] as usize + lane)[0];
                    let behind = count.at(block.behind[d] as usize + lane)[0];
                    moment += reference * gradient.transpose() * (ahead + behind);
                    sum += gradient * (ahead - behind);
                }
                let inverse = inverse_or_pseudo_inverse(&moment);
                let flatness = flatness(&moment);
                let at_rest = if flatness == Flatness::Full { Matrix3::identity() } else { moment * inverse };
                self.is_sloped |= flatness == Flatness::Sloped;
                self.gradient_sum.set(place, sum.into());
                self.moment_inverse.set(place, symmetric_part(&inverse));
                self.at_rest.set(place, symmetric_part(&at_rest));
                is_singular[place] = Some(flatness != Flatness::Full);
            }
            if is_singular[place] == Some(true) {
                self.singular_moment.push(entry);
            }
        }
    }

    /// Converts a vector from the axes of the lattice to those of the world.
    #[must_use]
    pub fn in_the_world(&self, vector: [f64; 3]) -> [f64; 3] {
        let mut turned = [0.0; 3];
        for (component, axis) in vector.into_iter().zip(self.lattice.axes) {
            turned[axis] = component;
        }
        turned
    }

    /// Returns the entries that no chain of neighbours connects to a held entry, ascending.
    #[must_use]
    pub fn unconnected(&self) -> Vec<u32> {
        let mut is_reached = vec![false; self.lattice.len];
        let held = self.entries.iter().filter(|entry| entry.is_held);
        let mut open: Vec<usize> = held.filter_map(|entry| entry.place).collect();
        for &place in &open {
            is_reached[place] = true;
        }
        while let Some(place) = open.pop() {
            let block = self.lattice.block_at(place);
            for &window in block.ahead.iter().chain(&block.behind) {
                let other = window as usize + place - block.slot;
                if self.presence.at(other)[0] > 0.0 && !is_reached[other] {
                    is_reached[other] = true;
                    open.push(other);
                }
            }
        }
        let is_connected = |entry: &Entry| entry.is_held || entry.place.is_some_and(|place| is_reached[place]);
        (0u32..).zip(&self.entries).filter(|(_, entry)| !is_connected(entry)).map(|(i, _)| i).collect()
    }
}

/// Returns the components xx, yy, zz, xy, xz, yz of a symmetric matrix.
fn symmetric_part(m: &Matrix3<f64>) -> [f64; 6] {
    [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(0, 1)], m[(0, 2)], m[(1, 2)]]
}

/// Counts the cells that repeat an earlier one.
fn repeated(cells: &[Cell]) -> usize {
    let mut sorted: Vec<_> = cells.iter().map(|cell| (cell.x, cell.y, cell.z)).collect();
    sorted.sort_unstable();
    sorted.dedup();
    cells.len() - sorted.len()
}
