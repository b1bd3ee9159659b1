//! The published method: a total-Lagrangian SPH simulation of the structure settling under its own weight
//! (`docs/rules.md#the-published-simulation`).

mod constitutive;
mod fields;
mod outcome;
mod pairs;
mod particles;
mod passes;
mod stencil;
mod storage;

use std::marker::PhantomData;
use std::ops::Range;

use nalgebra::Matrix3;
use pulp::Arch;

pub use outcome::{Diagnostics, Outcome};

use super::{Control, Stopped, WEIGHT_N};
use crate::voxel::Cell;
use fields::{Fields, SHORT, SHORTER};
use outcome::{Fate, fate, greatest_length};
use pairs::State;
use particles::Particles;
use passes::{Deform, Move, Pull, carry_out};
use storage::{Long, Short, Storage};

/// Mass of a particle, kg.
const MASS_KG: f64 = 15_000.0;
/// Time step, s.
const STEP_S: f64 = 1e-4;
/// Number of time steps.
const STEPS: u32 = 2_000;
/// Number of steps over which the weight grows to its full value.
const RAMP_STEPS: f64 = 400.0;
/// Work between two polls of the stop signal, in steps times blocks of eight cells: some milliseconds.
const WORK_PER_LOOK: usize = 20_000;

/// Least number of blocks at which the data of a step do not stay in the cache of a core.
const LARGE_BLOCKS: usize = 2_000;
/// Number of blocks by which a wave of passes goes on.
const WAVE_BLOCKS: usize = 64;
/// Number of blocks whose data stay in the cache that cores share, while the waves of several steps go over them.
const CACHED_BLOCKS: usize = 2_500;
/// Greatest number of steps whose waves follow each other.
const MAX_AT_ONCE: usize = 8;

/// Simulates `cells` (particles at block centres; a cell listed twice is two particles) and returns their stress.
///
/// Stress and displacement of a cell do not depend on the order of `cells`, nor on how cores share the work.
///
/// # Errors
/// Returns an error if `control` stops the computation; it is polled after some milliseconds of steps, or about ten times
/// a second in a large structure, and before and after setup, which takes some microseconds per block.
pub fn simulate(cells: &[Cell], control: &Control<'_>) -> Result<Outcome, Stopped> {
    simulate_with(Arch::new(), cells, control)
}

/// Simulates `cells` with the SIMD instructions of `arch`.
fn simulate_with(arch: Arch, cells: &[Cell], control: &Control<'_>) -> Result<Outcome, Stopped> {
    control.check(0.0)?;
    let particles = Particles::new(cells);
    match fields::stride(particles.lattice.len) {
        SHORTER => run(Simulation::<Short<SHORTER>>::new(arch, particles), cells, control),
        SHORT => run(Simulation::<Short<SHORT>>::new(arch, particles), cells, control),
        _ => run(Simulation::<Long>::new(arch, particles), cells, control),
    }
}

/// Takes all steps.
fn run<T: Storage>(mut simulation: Simulation<T>, cells: &[Cell], control: &Control<'_>) -> Result<Outcome, Stopped> {
    // If every particle is held, nothing moves: strain and its rate stay those of the second step.
    let steps = if simulation.particles.are_all_held { 2 } else { STEPS };
    let per_look = (WORK_PER_LOOK / simulation.particles.lattice.blocks.len().max(1)).clamp(1, 200);
    let per_look = per_look.next_multiple_of(simulation.at_once) as u32;
    for step in (0..steps - 1).step_by(per_look as usize) {
        control.check(f64::from(step) / f64::from(steps))?;
        simulation.advance(step..(step + per_look).min(steps - 1), control);
    }
    let (deformation, velocity) = (simulation.deformation.clone(), simulation.velocity.clone());
    simulation.advance(steps - 1..steps, control);
    Ok(simulation.outcome(cells, &deformation, &velocity))
}

#[derive(Debug)]
struct Simulation<T: Storage> {
    particles: Particles,
    arch: Arch,
    displacement: Fields<3>,
    /// Velocities, half a step later than the displacements.
    velocity: Fields<3>,
    deformation: Fields<9>,
    /// `P A^-1`.
    corrected_stress: Fields<9>,
    /// Forces between pairs on the particle behind, three components for each direction.
    forces: Fields<39>,
    /// Displacements times the number of particles in each cell, if particles share cells.
    weighted: Option<Fields<3>>,
    /// How far, in blocks, a pass must be ahead of the next one; `None` if everything fits into the cache.
    reach: Option<usize>,
    /// Number of steps whose passes follow each other.
    at_once: usize,
    storage: PhantomData<T>,
}

impl<T: Storage> Simulation<T> {
    fn new(arch: Arch, particles: Particles) -> Self {
        let len = particles.lattice.len;
        let mut deformation = Fields::zero(len);
        for place in particles.entries.iter().filter_map(|entry| entry.place) {
            deformation.set(place, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        }
        let reach = (particles.lattice.blocks.len() >= LARGE_BLOCKS).then(|| particles.lattice.reach());
        // Where cells hold several particles, displacements are multiplied for the whole structure after each step, so steps
        // cannot overlap.
        let follows = reach.filter(|_| particles.multiplicity.is_none());
        let at_once = follows.map_or(1, |reach| {
            let between_looks = 10 * WORK_PER_LOOK / particles.lattice.blocks.len();
            (CACHED_BLOCKS / (2 * reach + WAVE_BLOCKS)).min(between_looks).clamp(1, MAX_AT_ONCE)
        });
        Self {
            arch,
            displacement: Fields::zero(len),
            velocity: Fields::zero(len),
            deformation,
            corrected_stress: Fields::zero(len),
            forces: Fields::zero(len),
            weighted: particles.multiplicity.is_some().then(|| Fields::zero(len)),
            reach,
            at_once,
            particles,
            storage: PhantomData,
        }
    }

    /// Takes steps of the published integrator. Its forces are those of the positions before the step, so they lag one step
    /// behind a velocity Verlet scheme; scores depend on this.
    fn advance(&mut self, steps: Range<u32>, control: &Control<'_>) {
        let steps: Vec<u32> = steps.collect();
        for steps in steps.chunks(self.at_once) {
            if let Some(reach) = self.reach.filter(|_| control.join.is_none()) {
                self.advance_in_waves(reach, steps, control);
            } else {
                let blocks = self.particles.lattice.blocks.len();
                for step in steps {
                    self.deform(0..blocks, control);
                    self.move_on(0..blocks, *step, control);
                }
            }
            if let (Some(weighted), Some(multiplicity)) = (&mut self.weighted, &self.particles.multiplicity) {
                weighted.set_product(&self.displacement, multiplicity);
            }
        }
    }

    /// Lets the passes of these steps follow each other through the structure, as close as they may: what one pass writes is
    /// then still in the cache when the next reads it. Each number is computed as by one pass after the other.
    fn advance_in_waves(&mut self, reach: usize, steps: &[u32], control: &Control<'_>) {
        let blocks = self.particles.lattice.blocks.len();
        // Up to where a pass may go after one that has come this far, because it reads what is in reach.
        let behind = |done: usize| if done == blocks { blocks } else { done.saturating_sub(reach) };
        // Up to where each step has deformed and moved blocks.
        let mut done = vec![(0, 0); steps.len()];
        while done[steps.len() - 1].1 < blocks {
            let mut before = blocks;
            for (step, (deformed, moved)) in steps.iter().zip(&mut done) {
                // The stress of a block needs the positions that the step before gave to all blocks in reach. By then nothing
                // reads its old stress.
                let next = (*deformed + WAVE_BLOCKS).min(behind(before));
                if next > *deformed {
                    self.deform(*deformed..next, control);
                    *deformed = next;
                }
                // Forces need the stress of all blocks in reach, and a block moves once nothing reads where it was.
                let free = behind(*deformed);
                if free > *moved {
                    self.move_on(*moved..free, *step, control);
                    *moved = free;
                }
                before = *moved;
            }
        }
    }

    /// Computes deformation and stress of a range of blocks.
    fn deform(&mut self, range: Range<usize>, control: &Control<'_>) {
        let particles = &self.particles;
        let displacement = T::view(&self.displacement);
        let places = particles.lattice.places(&range);
        let deform = Deform::<T> {
            blocks: &particles.lattice.blocks[range],
            displacement,
            weighted: self.weighted.as_ref().map_or(displacement, T::view),
            gradient_sum: T::view(&particles.gradient_sum),
            moment_inverse: T::view(&particles.moment_inverse),
            at_rest: T::view(&particles.at_rest),
            weights: &particles.weights,
            step_s: STEP_S,
            deformation: T::part(&mut self.deformation, places.clone()),
            corrected_stress: T::part(&mut self.corrected_stress, places),
        };
        carry_out(deform, self.arch, control);
    }

    /// Takes the rest of a step for a range of blocks: computes the forces between pairs, and moves the particles.
    fn move_on(&mut self, range: Range<usize>, step: u32, control: &Control<'_>) {
        let weight = WEIGHT_N * (f64::from(step) / RAMP_STEPS).min(1.0);
        let load_n = self.particles.lattice.axes.map(|axis| if axis == 1 { -weight } else { 0.0 });
        if self.particles.multiplicity.is_none() {
            self.move_particles::<false>(range, load_n, control);
        } else {
            self.move_particles::<true>(range, load_n, control);
        }
    }

    fn move_particles<const SHARED: bool>(&mut self, range: Range<usize>, load_n: [f64; 3], control: &Control<'_>) {
        let (particles, arch) = (&self.particles, self.arch);
        let places = particles.lattice.places(&range);
        let (blocks, weights) = (&particles.lattice.blocks[range], &particles.weights);
        let presence = T::view(&particles.presence);
        let displacement = T::view(&self.displacement);
        let (deformation, corrected_stress) = (T::view(&self.deformation), T::view(&self.corrected_stress));
        let state = State { displacement, deformation, corrected_stress, presence };
        carry_out(
            Pull::<T> { blocks, state, weights, forces: T::part(&mut self.forces, places.clone()) },
            arch,
            control,
        );
        let forward = Move::<T, SHARED> {
            blocks,
            forces: T::view(&self.forces),
            multiplicity: T::view(particles.multiplicity.as_ref().unwrap_or(&particles.presence)),
            rest: T::view(&particles.rest),
            is_free: T::view(&particles.is_free),
            load_n,
            step_s: STEP_S,
            step_per_mass: STEP_S / MASS_KG,
            displacement: T::part(&mut self.displacement, places.clone()),
            velocity: T::part(&mut self.velocity, places),
        };
        carry_out(forward, arch, control);
    }

    /// Returns the outcome, from the states after and before the last step.
    fn outcome(self, cells: &[Cell], deformation_before: &Fields<9>, velocity_before: &Fields<3>) -> Outcome {
        let particles = &self.particles;
        let mut diagnostics = Diagnostics {
            singular_moment: particles.singular_moment.clone(),
            unconnected: particles.unconnected(),
            repeated_cells: particles.repeated_cells,
            ..Diagnostics::default()
        };
        let matrix = |numbers: [f64; 9]| Matrix3::from_row_slice(&numbers);
        let fall = free_fall();
        let mut outcome = Outcome::default();
        let mut residuals = Vec::with_capacity(cells.len());
        for (number, entry) in (0u32..).zip(&particles.entries) {
            let Some(place) = entry.place else {
                // Without neighbours F is 0: the particle has no stress, and falls unless it is held.
                diagnostics.degenerate.push(number);
                let (fallen, speed) = if entry.is_held { (0.0, 0.0) } else { fall };
                outcome.von_mises_pa.push(0.0);
                outcome.displacement_m.push([0.0, fallen, 0.0]);
                diagnostics.kinetic_energy_j += 0.5 * MASS_KG * speed * speed;
                residuals.push([0.0, if entry.is_held { 0.0 } else { -WEIGHT_N }, 0.0]);
                continue;
            };
            let f = matrix(self.deformation.at(place));
            let p = constitutive::stress_of_one(&f, &matrix(deformation_before.at(place)), STEP_S);
            outcome.von_mises_pa.push(match fate(&p, &f) {
                Fate::Stressed(stress_pa) => stress_pa,
                Fate::Degenerate => {
                    diagnostics.degenerate.push(number);
                    0.0
                }
                Fate::NonFinite => {
                    diagnostics.non_finite.push(number);
                    0.0
                }
            });
            outcome.displacement_m.push(particles.in_the_world(self.displacement.at(place)));
            let (before, after) = (velocity_before.at(place), self.velocity.at(place));
            let now: [f64; 3] = std::array::from_fn(|k| f64::midpoint(before[k], after[k]));
            diagnostics.kinetic_energy_j += 0.5 * MASS_KG * now.iter().map(|v| v * v).sum::<f64>();
            residuals.push(std::array::from_fn(|k| (after[k] - before[k]) * (MASS_KG / STEP_S)));
        }
        let is_number = outcome.von_mises_pa.iter().all(|stress| !stress.is_nan());
        let greatest = outcome.von_mises_pa.iter().copied().fold(0.0, f64::max);
        // Ties go to the least cell, whatever the order of the list.
        let stress = &outcome.von_mises_pa;
        let most = (0..cells.len()).filter(|&i| greatest > 0.0 && stress[i] == greatest).min_by_key(|&i| cells[i]);
        outcome.most_stressed = most;
        outcome.max_von_mises_pa = if is_number { greatest } else { f64::NAN };
        diagnostics.max_displacement_m = greatest_length(outcome.displacement_m.iter().copied());
        diagnostics.residual_force_n = greatest_length(residuals);
        diagnostics.sloped = particles.is_sloped;
        diagnostics.order_sensitive =
            diagnostics.sloped || diagnostics.repeated_cells > 0 || !is_number || !diagnostics.non_finite.is_empty();
        outcome.diagnostics = diagnostics;
        outcome
    }
}

/// Returns the displacement, in blocks, and the velocity, in blocks per second, of a particle without neighbours at the
/// end.
fn free_fall() -> (f64, f64) {
    let (mut height, mut velocity, mut before) = (0.0, 0.0, 0.0);
    for step in 0..STEPS {
        before = velocity;
        height += velocity * STEP_S;
        velocity -= WEIGHT_N * (f64::from(step) / RAMP_STEPS).min(1.0) * STEP_S / MASS_KG;
    }
    (height, f64::midpoint(before, velocity))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the bits of all numbers.
    fn bits<const N: usize>(fields: &Fields<N>) -> Vec<u64> {
        fields.columns().iter().map(|number| number.to_bits()).collect()
    }

    /// Columns of a length that the compiler knows hold the same numbers as those of any length.
    #[test]
    fn short_columns_change_no_bit() {
        let cells: Vec<Cell> =
            (0..7 * 5 * 6).map(|i| Cell::new(i % 7, i / 7 % 5, i / 35)).filter(|cell| cell.x * cell.y != 6).collect();
        for repeated in [None, Some(cells[20])] {
            let cells: Vec<Cell> = cells.iter().copied().chain(repeated).collect();
            let mut short = Simulation::<Short<SHORTER>>::new(Arch::new(), Particles::new(&cells));
            let mut long = Simulation::<Long>::new(Arch::new(), Particles::new(&cells));
            short.advance(0..50, &Control::unhurried());
            long.advance(0..50, &Control::unhurried());
            assert!(long.displacement.columns().iter().any(|moved| *moved < 0.0));
            assert_eq!(bits(&short.displacement), bits(&long.displacement));
            assert_eq!(bits(&short.velocity), bits(&long.velocity));
        }
    }

    /// Compares all kinds of SIMD vectors of this processor: those that round a product and sum once agree bit for bit,
    /// others nearly.
    #[test]
    fn every_kind_of_processor_agrees() {
        let cells: Vec<Cell> =
            (0..4 * 4 * 5).map(|i| Cell::new(i % 4, i / 4 % 4, i / 16)).chain([Cell::new(0, 4, 1)]).collect();
        let simulate = |arch| simulate_with(arch, &cells, &Control::unhurried()).unwrap().von_mises_pa;
        let plain = simulate(Arch::Scalar);
        for (a, b) in plain.iter().zip(simulate(Arch::new())) {
            assert!((a - b).abs() <= 1e-7 * b + 1e-4, "plain {a} Pa, vectors {b} Pa");
        }
        #[cfg(target_arch = "x86_64")]
        if let (Some(narrow), Some(wide)) = (pulp::x86::V3::try_new(), pulp::x86::V4::try_new()) {
            assert_eq!(simulate(Arch::V3(narrow)), simulate(Arch::V4(wide)));
        }
    }

    /// Passes that follow each other closely compute the same numbers as one after the other, also where some cells hold
    /// two particles and where there are holes.
    #[test]
    fn waves_change_no_bit() {
        let mut cells: Vec<Cell> = (0..24 * 18 * 30).map(|i| Cell::new(i % 24, i / 24 % 18, i / 24 / 18)).collect();
        cells.retain(|cell| (cell.x * 7 + cell.y * 5 + cell.z * 11) % 13 != 0);
        for repeated in [None, Some(cells[5_000])] {
            let cells: Vec<Cell> = cells.iter().copied().chain(repeated).collect();
            let mut in_waves = Simulation::<Long>::new(Arch::new(), Particles::new(&cells));
            let mut in_turn = Simulation::<Long>::new(Arch::new(), Particles::new(&cells));
            let lattice = &in_waves.particles.lattice;
            assert!(4 * lattice.reach() < lattice.blocks.len());
            (in_waves.reach, in_turn.reach) = (Some(lattice.reach()), None);
            // Seven does not divide the number of steps. Where displacements are multiplied, steps cannot overlap.
            in_waves.at_once = if repeated.is_none() { 7 } else { 1 };
            in_waves.advance(0..20, &Control::unhurried());
            in_turn.advance(0..20, &Control::unhurried());
            assert!(in_turn.displacement.columns().iter().any(|moved| *moved < 0.0));
            assert_eq!(bits(&in_waves.displacement), bits(&in_turn.displacement));
            assert_eq!(bits(&in_waves.velocity), bits(&in_turn.velocity));
            assert_eq!(bits(&in_waves.deformation), bits(&in_turn.deformation));
            assert_eq!(bits(&in_waves.corrected_stress), bits(&in_turn.corrected_stress));
        }
    }
}
