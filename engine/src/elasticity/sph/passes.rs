//! The three passes of a time step over the particles, each of which several cores can share.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use pulp::{Arch, Simd, WithSimd};

use super::constitutive;
use super::fields::SHORT;
use super::pairs::{self, State};
use super::stencil::{Matrices, Place, Weights, offsets};
use super::storage::{Part, Storage, View};
use crate::elasticity::Control;
use crate::elasticity::lanes::Lanes;
use crate::elasticity::lattice::{BLOCK, Block};

/// Least number of blocks per share of a pass: handing over fewer costs as much as processing them.
const BLOCKS_PER_SHARE: usize = 128;
const _: () = assert!(SHORT / BLOCK < 2 * BLOCKS_PER_SHARE, "short columns cannot be split");

/// Operation on each of a range of blocks, independent of the others.
pub trait Pass: WithSimd<Output = ()> + Send + Sized {
    /// Returns the blocks.
    fn blocks(&self) -> &[Block];
    /// Splits the pass into those over the blocks before and from one.
    fn split_at(self, block: usize) -> (Self, Self);
}

/// Runs a pass, on several cores if it is large and the caller lends them.
pub fn carry_out<P: Pass>(pass: P, arch: Arch, control: &Control<'_>) {
    let blocks = pass.blocks().len();
    if control.join.is_some() && blocks >= 2 * BLOCKS_PER_SHARE {
        let (first, second) = pass.split_at(blocks / 2);
        control.both(|| carry_out(first, arch, control), || carry_out(second, arch, control));
    } else {
        arch.dispatch(pass);
    }
}

/// First pass: deformation gradients and stress from displacements.
#[derive(Debug)]
pub struct Deform<'a, T: Storage> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// Displacements.
    pub displacement: T::View<'a, 3>,
    /// Displacements as neighbours count them: times the number of particles in the cell.
    pub weighted: T::View<'a, 3>,
    /// `sum_j grad W_ij`.
    pub gradient_sum: T::View<'a, 3>,
    /// `A^-1`: xx, yy, zz, xy, xz, yz.
    pub moment_inverse: T::View<'a, 6>,
    /// `A A^-1`, the deformation gradient at rest, in the same order.
    pub at_rest: T::View<'a, 6>,
    /// Weights of the kernel.
    pub weights: &'a Weights,
    /// Time step, s.
    pub step_s: f64,
    /// Deformation gradients, row by row: those of the previous step, which the pass replaces with those of this step.
    pub deformation: T::Part<'a, 9>,
    /// `P A^-1`, row by row.
    pub corrected_stress: T::Part<'a, 9>,
}

impl<T: Storage> Pass for Deform<'_, T> {
    fn blocks(&self) -> &[Block] {
        self.blocks
    }

    fn split_at(self, block: usize) -> (Self, Self) {
        let place = self.blocks[block].slot;
        let (blocks, later_blocks) = self.blocks.split_at(block);
        let (deformation, later_deformation) = self.deformation.split_at(place);
        let (corrected_stress, later_stress) = self.corrected_stress.split_at(place);
        let later =
            Self { blocks: later_blocks, deformation: later_deformation, corrected_stress: later_stress, ..self };
        (Self { blocks, deformation, corrected_stress, ..later }, later)
    }
}

impl<T: Storage> WithSimd for Deform<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.displacement = self.displacement.levelled();
        self.weighted = self.weighted.levelled();
        self.gradient_sum = self.gradient_sum.levelled();
        self.moment_inverse = self.moment_inverse.levelled();
        self.at_rest = self.at_rest.levelled();
        self.deformation = self.deformation.levelled();
        self.corrected_stress = self.corrected_stress.levelled();
        for block in self.blocks {
            for offset in offsets(S::F64_LANES) {
                self.at(&Place::new(simd, block, offset));
            }
        }
    }
}

impl<T: Storage> Deform<'_, T> {
    #[inline(always)]
    fn at<S: Simd>(&mut self, place: &Place<'_, S>) {
        let own = place.own;
        // F = A A^-1 + [sum_j u_j (x) grad W - u_i (x) sum_j grad W] A^-1.
        let mut sum = place.outer_sum(self.weighted, self.weights);
        let displacement = place.load(self.displacement, own);
        let gradient_sum = place.load(self.gradient_sum, own);
        for i in 0..3 {
            for k in 0..3 {
                sum[i][k] = displacement[i].subtract_product_from(gradient_sum[k], sum[i][k]);
            }
        }
        let inverse = symmetric(place.load(self.moment_inverse, own));
        let f = sum_and_product(&symmetric(place.load(self.at_rest, own)), &sum, &inverse);
        let at = own - self.deformation.first();
        let mut before = f;
        for i in 0..3 {
            for j in 0..3 {
                before[i][j] = Lanes::load(place.simd, self.deformation.column(3 * i + j), at);
            }
        }
        let p = constitutive::stress(place, &f, &before, self.step_s);
        let q = product(&p, &inverse);
        for i in 0..3 {
            for j in 0..3 {
                f[i][j].store(self.deformation.column_mut(3 * i + j), at);
                q[i][j].store(self.corrected_stress.column_mut(3 * i + j), at);
            }
        }
    }
}

/// Returns the symmetric matrix with these components: xx, yy, zz, xy, xz, yz.
#[inline(always)]
fn symmetric<S: Simd>([xx, yy, zz, xy, xz, yz]: [Lanes<S>; 6]) -> Matrices<S> {
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

/// Returns `a b`.
#[inline(always)]
fn product<S: Simd>(a: &Matrices<S>, b: &Matrices<S>) -> Matrices<S> {
    let mut product = *a;
    for i in 0..3 {
        for j in 0..3 {
            product[i][j] = a[i][0].mul_add(b[0][j], a[i][1].mul_add(b[1][j], a[i][2] * b[2][j]));
        }
    }
    product
}

/// Returns `c + a b`.
#[inline(always)]
fn sum_and_product<S: Simd>(c: &Matrices<S>, a: &Matrices<S>, b: &Matrices<S>) -> Matrices<S> {
    let mut sum = *c;
    for i in 0..3 {
        for j in 0..3 {
            sum[i][j] = a[i][0].mul_add(b[0][j], a[i][1].mul_add(b[1][j], a[i][2].mul_add(b[2][j], c[i][j])));
        }
    }
    sum
}

/// Second pass: forces between pairs.
#[derive(Debug)]
pub struct Pull<'a, T: Storage> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// State that the forces depend on.
    pub state: State<'a, T>,
    /// Weights of the kernel.
    pub weights: &'a Weights,
    /// The forces from particles ahead, three components for each direction.
    pub forces: T::Part<'a, 39>,
}

impl<T: Storage> Pass for Pull<'_, T> {
    fn blocks(&self) -> &[Block] {
        self.blocks
    }

    fn split_at(self, block: usize) -> (Self, Self) {
        let (blocks, later_blocks) = self.blocks.split_at(block);
        let (forces, later_forces) = self.forces.split_at(self.blocks[block].slot);
        (Self { blocks, forces, ..self }, Self { blocks: later_blocks, forces: later_forces, ..self })
    }
}

impl<T: Storage> WithSimd for Pull<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.state = self.state.levelled();
        self.forces = self.forces.levelled();
        for block in self.blocks {
            for offset in offsets(S::F64_LANES) {
                pairs::pull(&Place::new(simd, block, offset), &self.state, self.weights, &mut self.forces);
            }
        }
    }
}

/// Third pass: the step in time. `SHARED` says that several particles may share a cell.
#[derive(Debug)]
pub struct Move<'a, T: Storage, const SHARED: bool> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// The forces from particles ahead, three components for each direction.
    pub forces: T::View<'a, 39>,
    /// Number of particles in each cell; unused if `SHARED` is false.
    pub multiplicity: T::View<'a, 1>,
    /// Positions at rest, relative to the least corner.
    pub rest: T::View<'a, 3>,
    /// Above 0 where there is a particle that is not held.
    pub is_free: T::View<'a, 1>,
    /// Load on each particle along the axes of the lattice, N.
    pub load_n: [f64; 3],
    /// Time step, s.
    pub step_s: f64,
    /// Step over mass, s/kg.
    pub step_per_mass: f64,
    /// Displacements.
    pub displacement: T::Part<'a, 3>,
    /// Velocities, half a step later than the displacements.
    pub velocity: T::Part<'a, 3>,
}

impl<T: Storage, const SHARED: bool> Pass for Move<'_, T, SHARED> {
    fn blocks(&self) -> &[Block] {
        self.blocks
    }

    fn split_at(self, block: usize) -> (Self, Self) {
        let place = self.blocks[block].slot;
        let (blocks, later_blocks) = self.blocks.split_at(block);
        let (displacement, later_displacement) = self.displacement.split_at(place);
        let (velocity, later_velocity) = self.velocity.split_at(place);
        let later = Self { blocks: later_blocks, displacement: later_displacement, velocity: later_velocity, ..self };
        (Self { blocks, displacement, velocity, ..later }, later)
    }
}

impl<T: Storage, const SHARED: bool> WithSimd for Move<'_, T, SHARED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.forces = self.forces.levelled();
        self.rest = self.rest.levelled();
        self.displacement = self.displacement.levelled();
        self.velocity = self.velocity.levelled();
        for block in self.blocks.iter().filter(|block| block.is_free) {
            for offset in offsets(S::F64_LANES) {
                self.at(&Place::new(simd, block, offset));
            }
        }
    }
}

impl<T: Storage, const SHARED: bool> Move<'_, T, SHARED> {
    #[inline(always)]
    fn at<S: Simd>(&mut self, place: &Place<'_, S>) {
        let sum = pairs::sum::<S, SHARED>(place, self.forces, self.multiplicity.column(0));
        let is_free = Lanes::load(place.simd, self.is_free.column(0), place.own);
        let (step, step_per_mass) = (place.splat(self.step_s), place.splat(self.step_per_mass));
        let at = place.own - self.displacement.first();
        for i in 0..3 {
            let force = sum[i] + place.splat(self.load_n[i]);
            let displacement = Lanes::load(place.simd, self.displacement.column(i), at);
            let velocity = Lanes::load(place.simd, self.velocity.column(i), at);
            // Round as a position, which is what the published evaluator keeps: in unstable structures this rounding is
            // the seed of the instability.
            let rest = Lanes::load(place.simd, self.rest.column(i), place.own);
            let moved = velocity.mul_add(step, displacement + rest) - rest;
            let faster = force.mul_add(step_per_mass, velocity);
            moved.where_positive(is_free, displacement).store(self.displacement.column_mut(i), at);
            faster.where_positive(is_free, velocity).store(self.velocity.column_mut(i), at);
        }
    }
}
