//! The three passes of a time step over the particles, each of which several cores can share.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use pulp::{Arch, Simd, WithSimd};

use super::constitutive;
use super::fields::{Part, cut, offsets};
use super::pairs::{self, State};
use super::stencil::{Matrices, Place, Weights};
use crate::elasticity::Control;
use crate::elasticity::lanes::Lanes;
use crate::elasticity::lattice::Block;

/// Least number of blocks per share of a pass: handing over fewer costs as much as processing them.
const BLOCKS_PER_SHARE: usize = 128;

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
    match control.join {
        Some(join) if blocks >= 2 * BLOCKS_PER_SHARE => {
            let (first, second) = pass.split_at(blocks / 2);
            let (mut first, mut second) = (Some(first), Some(second));
            let mut do_first = || first.take().into_iter().for_each(|pass| carry_out(pass, arch, control));
            let mut do_second = || second.take().into_iter().for_each(|pass| carry_out(pass, arch, control));
            join(&mut do_first, &mut do_second);
        }
        _ => arch.dispatch(pass),
    }
}

/// First pass: deformation gradients and stress from displacements.
#[derive(Debug)]
pub struct Deform<'a> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// Displacements.
    pub displacement: [&'a [f64]; 3],
    /// Displacements as neighbours count them: times the number of particles in the cell.
    pub weighted: [&'a [f64]; 3],
    /// `sum_j grad W_ij`.
    pub gradient_sum: [&'a [f64]; 3],
    /// `A^-1`: xx, yy, zz, xy, xz, yz.
    pub moment_inverse: [&'a [f64]; 6],
    /// `A A^-1`, the deformation gradient at rest, in the same order.
    pub at_rest: [&'a [f64]; 6],
    /// Weights of the kernel.
    pub weights: &'a Weights,
    /// Time step, s.
    pub step_s: f64,
    /// Deformation gradients, row by row: those of the previous step, which the pass replaces with those of this step.
    pub deformation: Part<'a, 9>,
    /// `P A^-1`, row by row.
    pub corrected_stress: Part<'a, 9>,
}

impl Pass for Deform<'_> {
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

impl WithSimd for Deform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (all, own) = (self.displacement[0].len(), self.deformation.len());
        self.displacement = cut(self.displacement, all);
        self.weighted = cut(self.weighted, all);
        self.gradient_sum = cut(self.gradient_sum, all);
        self.moment_inverse = cut(self.moment_inverse, all);
        self.at_rest = cut(self.at_rest, all);
        self.deformation = self.deformation.cut(own);
        self.corrected_stress = self.corrected_stress.cut(own);
        for block in self.blocks {
            for offset in offsets(S::F64_LANES) {
                self.at(&Place::new(simd, block, offset));
            }
        }
    }
}

impl Deform<'_> {
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
        let at = own - self.deformation.first;
        let mut before = f;
        for i in 0..3 {
            for j in 0..3 {
                before[i][j] = Lanes::load(place.simd, self.deformation.components[3 * i + j], at);
            }
        }
        let p = constitutive::stress(place, &f, &before, self.step_s);
        let q = product(&p, &inverse);
        for i in 0..3 {
            for j in 0..3 {
                f[i][j].store(self.deformation.components[3 * i + j], at);
                q[i][j].store(self.corrected_stress.components[3 * i + j], at);
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
pub struct Pull<'a> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// State that the forces depend on.
    pub state: State<'a>,
    /// Weights of the kernel.
    pub weights: &'a Weights,
    /// The forces from particles ahead, three components for each direction.
    pub forces: Part<'a, 39>,
}

impl Pass for Pull<'_> {
    fn blocks(&self) -> &[Block] {
        self.blocks
    }

    fn split_at(self, block: usize) -> (Self, Self) {
        let (blocks, later_blocks) = self.blocks.split_at(block);
        let (forces, later_forces) = self.forces.split_at(self.blocks[block].slot);
        (Self { blocks, forces, ..self }, Self { blocks: later_blocks, forces: later_forces, ..self })
    }
}

impl WithSimd for Pull<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (all, own) = (self.state.displacement[0].len(), self.forces.len());
        self.state.displacement = cut(self.state.displacement, all);
        self.state.deformation = cut(self.state.deformation, all);
        self.state.corrected_stress = cut(self.state.corrected_stress, all);
        [self.state.presence] = cut([self.state.presence], all);
        self.forces = self.forces.cut(own);
        for block in self.blocks {
            for offset in offsets(S::F64_LANES) {
                let place = Place::new(simd, block, offset);
                pairs::pull(
                    &place,
                    &self.state,
                    self.weights,
                    place.own - self.forces.first,
                    &mut self.forces.components,
                );
            }
        }
    }
}

/// Third pass: the step in time. `SHARED` says that several particles may share a cell.
#[derive(Debug)]
pub struct Move<'a, const SHARED: bool> {
    /// Blocks to process.
    pub blocks: &'a [Block],
    /// The forces from particles ahead, three components for each direction.
    pub forces: [&'a [f64]; 39],
    /// Number of particles in each cell; unused if `SHARED` is false.
    pub multiplicity: &'a [f64],
    /// Positions at rest, relative to the least corner.
    pub rest: [&'a [f64]; 3],
    /// Above 0 where there is a particle that is not held.
    pub is_free: &'a [f64],
    /// Load on each particle along the axes of the lattice, N.
    pub load_n: [f64; 3],
    /// Time step, s.
    pub step_s: f64,
    /// Step over mass, s/kg.
    pub step_per_mass: f64,
    /// Displacements.
    pub displacement: Part<'a, 3>,
    /// Velocities, half a step later than the displacements.
    pub velocity: Part<'a, 3>,
}

impl<const SHARED: bool> Pass for Move<'_, SHARED> {
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

impl<const SHARED: bool> WithSimd for Move<'_, SHARED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (all, own) = (self.is_free.len(), self.displacement.len());
        self.forces = cut(self.forces, all);
        self.rest = cut(self.rest, all);
        [self.is_free, self.multiplicity] = cut([self.is_free, self.multiplicity], all);
        self.displacement = self.displacement.cut(own);
        self.velocity = self.velocity.cut(own);
        for block in self.blocks {
            for offset in offsets(S::F64_LANES) {
                self.at(&Place::new(simd, block, offset));
            }
        }
    }
}

impl<const SHARED: bool> Move<'_, SHARED> {
    #[inline(always)]
    fn at<S: Simd>(&mut self, place: &Place<'_, S>) {
        let sum = pairs::sum::<S, SHARED>(place, self.forces, self.multiplicity);
        let is_free = Lanes::load(place.simd, self.is_free, place.own);
        let (step, step_per_mass) = (place.splat(self.step_s), place.splat(self.step_per_mass));
        let at = place.own - self.displacement.first;
        for i in 0..3 {
            let force = sum[i] + place.splat(self.load_n[i]);
            let displacement = Lanes::load(place.simd, self.displacement.components[i], at);
            let velocity = Lanes::load(place.simd, self.velocity.components[i], at);
            // Round as a position, which is what the published evaluator keeps: in unstable structures this rounding is
            // the seed of the instability.
            let rest = Lanes::load(place.simd, self.rest[i], place.own);
            let moved = velocity.mul_add(step, displacement + rest) - rest;
            let faster = force.mul_add(step_per_mass, velocity);
            moved.where_positive(is_free, displacement).store(self.displacement.components[i], at);
            faster.where_positive(is_free, velocity).store(self.velocity.components[i], at);
        }
    }
}
