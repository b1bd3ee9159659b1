//! The particles of a simulation: their places, and what stays the same through all steps.

use nalgebra::{Matrix3, Vector3};

use super::fields::Fields;
use super::stencil::Weights;
use crate::elasticity::lattice::Lattice;
use crate::elasticity::neighbours::{DIRECTIONS, kernel_gradient};
use crate::elasticity::small_matrix::{Flatness, flatness, inverse_or_pseudo_inverse};
use crate::voxel::Cell;

/// What stays the same through all steps.
#[derive(Debug)]
pub struct Particles {
    /// Where they are stored.
    pub lattice: Lattice,
    /// What the kernel says.
    pub weights: Weights,
    /// `sum_j grad W_ij`.
    pub gradient_sum: Fields<3>,
    /// `A^-1`: xx, yy, zz, xy, xz, yz.
    pub moment_inverse: Fields<6>,
    /// `A A^-1`, likewise: the deformation gradient at rest, the identity unless A is singular.
    pub at_rest: Fields<6>,
    /// 1 where a particle is, otherwise 0.
    pub presence: Fields<1>,
    /// 1 where a particle is that is not held.
    pub is_free: Fields<1>,
    /// How many particles share each place, where some do.
    pub multiplicity: Option<Fields<1>>,
    /// Whether each entry is at the least y.
    pub is_held: Vec<bool>,
    /// Whether every particle with neighbours is held.
    pub are_all_held: bool,
    /// Entries whose A is singular.
    pub singular_moment: Vec<u32>,
    /// Whether some neighbourhood is flat in a plane or line that is not one of the axes'.
    pub is_sloped: bool,
    /// Entries that share their cell with an earlier one.
    pub repeated_cells: usize,
}

impl Particles {
    /// Particles at the centres of `cells`.
    #[must_use]
    pub fn new(cells: &[Cell]) -> Self {
        let lattice = Lattice::of(cells);
        let len = lattice.len;
        let lowest = cells.iter().map(|cell| cell.y).min().unwrap_or(0);
        let is_held: Vec<bool> = cells.iter().map(|cell| cell.y == lowest).collect();
        let mut count = Fields::<1>::zero(len);
        let (mut presence, mut is_free) = (Fields::<1>::zero(len), Fields::<1>::zero(len));
        let mut are_all_held = true;
        for (&place, &is_held) in lattice.slot.iter().zip(&is_held) {
            let Some(place) = place else { continue };
            count.set(place, [count.at(place)[0] + 1.0]);
            presence.set(place, [1.0]);
            is_free.set(place, [if is_held { 0.0 } else { 1.0 }]);
            are_all_held &= is_held;
        }
        let mut particles = Self {
            weights: Weights::new(),
            gradient_sum: Fields::zero(len),
            moment_inverse: Fields::zero(len),
            at_rest: Fields::zero(len),
            presence,
            is_free,
            multiplicity: None,
            is_held,
            are_all_held,
            singular_moment: Vec::new(),
            is_sloped: false,
            repeated_cells: repeated(cells),
            lattice,
        };
        particles.measure(&count);
        particles.multiplicity = (particles.repeated_cells > 0).then_some(count);
        particles
    }

    /// Sums over the neighbours of each particle.
    fn measure(&mut self, count: &Fields<1>) {
        let gradients = DIRECTIONS.map(|direction| kernel_gradient(&Vector3::from(direction.map(f64::from))));
        for (entry, place) in (0u32..).zip(&self.lattice.slot) {
            let Some(place) = *place else {
                self.singular_moment.push(entry);
                continue;
            };
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
            if flatness != Flatness::Full {
                self.singular_moment.push(entry);
            }
            self.gradient_sum.set(place, sum.into());
            self.moment_inverse.set(place, symmetric_part(&inverse));
            self.at_rest.set(place, symmetric_part(&at_rest));
        }
    }

    /// A vector in the axes of the world, from one in those of the lattice.
    #[must_use]
    pub fn in_the_world(&self, vector: [f64; 3]) -> [f64; 3] {
        let mut turned = [0.0; 3];
        for (component, axis) in vector.into_iter().zip(self.lattice.axes) {
            turned[axis] = component;
        }
        turned
    }

    /// Entries that no chain of neighbours connects with a held one, ascending.
    #[must_use]
    pub fn unconnected(&self) -> Vec<u32> {
        let mut is_reached = vec![false; self.lattice.len];
        let held = self.lattice.slot.iter().zip(&self.is_held).filter(|(_, is_held)| **is_held);
        let mut open: Vec<usize> = held.filter_map(|(place, _)| *place).collect();
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
        let is_connected = |place: &Option<usize>, is_held: bool| is_held || place.is_some_and(|at| is_reached[at]);
        let entries = (0u32..).zip(self.lattice.slot.iter().zip(&self.is_held));
        entries.filter(|(_, (place, is_held))| !is_connected(place, **is_held)).map(|(entry, _)| entry).collect()
    }
}

/// xx, yy, zz, xy, xz, yz.
fn symmetric_part(m: &Matrix3<f64>) -> [f64; 6] {
    [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(0, 1)], m[(0, 2)], m[(1, 2)]]
}

/// How many cells are listed before.
fn repeated(cells: &[Cell]) -> usize {
    let mut sorted: Vec<_> = cells.iter().map(|cell| (cell.x, cell.y, cell.z)).collect();
    sorted.sort_unstable();
    sorted.dedup();
    cells.len() - sorted.len()
}
