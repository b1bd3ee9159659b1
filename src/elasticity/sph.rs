//! The published method: a total-Lagrangian SPH simulation of the structure settling under its own weight (SPEC 4).

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use multiversion::multiversion;
use nalgebra::{Matrix3, Vector3};

use super::Stopped;
use super::constitutive::Materials;
use super::neighbours::{Neighbours, kernel_gradient};
use super::pairs::{Columns, Field, Pairs, Vec4};
use super::small_matrix::{Flatness, flatness, inverse_or_pseudo_inverse};
use crate::voxel::{Bounds, Cell};

/// Weight of a block, N.
const WEIGHT_N: f64 = 900.0;
/// Mass that a force accelerates, kg.
const MASS_KG: f64 = 15_000.0;
/// Time step, s.
const STEP_S: f64 = 1e-4;
/// Steps simulated.
const STEPS: u32 = 2_000;
/// Steps over which the weight grows to its full value.
const RAMP_STEPS: f64 = 400.0;
/// Below this |det F| a particle's stress counts as 0.
const DEGENERATE_JACOBIAN: f64 = 1e-12;
/// Steps between two looks at the stop signal.
const STEPS_PER_LOOK: u32 = 16;

/// Result of a simulation.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Greatest von Mises stress, Pa; not a number where a particle's stress is not.
    pub max_von_mises_pa: f64,
    /// Von Mises stress per entry, in the order given, Pa; 0 where the method leaves a particle out.
    pub von_mises_pa: Vec<f64>,
    /// Entry with the greatest stress.
    pub most_stressed: Option<usize>,
    /// Entries whose neighbours lie in one plane or line, so that their moment matrix A is singular.
    pub singular_moment: Vec<u32>,
    /// Entries left out because |det F| < 1e-12.
    pub degenerate: usize,
    /// Entries left out because det F is not finite: the simulation blew up there.
    pub non_finite: usize,
    /// Entries that share their cell with an earlier entry.
    pub repeated_cells: usize,
    /// Whether rounding decides the result, so that it is undefined (conformance quirks 1 and 2).
    pub order_sensitive: bool,
}

impl Outcome {
    /// Why the result must be read with care, in words; empty for a sound one.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let mut cautions = Vec::new();
        if !self.singular_moment.is_empty() {
            cautions.push(format!(
                "{} blocks have all neighbours in one plane or line (singular moment matrix): their stress is an \
                 artefact of the published method",
                self.singular_moment.len()
            ));
        }
        if self.degenerate > 0 {
            cautions.push(format!("{} blocks are left out because |det F| < 1e-12", self.degenerate));
        }
        if self.non_finite > 0 {
            cautions.push(format!("{} blocks are left out because the simulation blew up there", self.non_finite));
        }
        if self.repeated_cells > 0 {
            cautions.push(format!("{} entries share a cell with an earlier entry", self.repeated_cells));
        }
        if self.order_sensitive {
            cautions.push(
                "the figure is undefined: rounding decides it, and another order of the blocks gives another value"
                    .to_owned(),
            );
        }
        cautions
    }
}

/// Simulates `cells` (particles at block centres; a cell listed twice is two particles) and gives their stress.
///
/// # Errors
/// Where `stop` says true, which is asked every 16 steps.
pub fn simulate(cells: &[Cell], stop: &(dyn Fn() -> bool + Sync)) -> Result<Outcome, Stopped> {
    let mut simulation = Simulation::new(cells);
    for step in (0..STEPS).step_by(STEPS_PER_LOOK as usize) {
        if stop() {
            return Err(Stopped);
        }
        simulation.advance(step, STEPS_PER_LOOK.min(STEPS - step));
    }
    Ok(simulation.outcome(cells))
}

/// A directed neighbour, as the deformation gradient needs it.
#[derive(Debug, Clone, Copy)]
struct Neighbour {
    to: u32,
    /// `A_i^-T grad W`, so that `F_i` is the sum of `(x_j - x_i) (x)` this.
    weight: [f64; 3],
}

#[derive(Debug)]
struct Simulation {
    /// Where each particle's neighbours begin; one longer than the particles.
    start: Vec<usize>,
    neighbours: Vec<Neighbour>,
    pairs: Pairs,
    materials: Materials,
    singular_moment: Vec<u32>,
    /// Whether some neighbourhood is flat in a plane or line that is not one of the axes'.
    is_sloped: bool,
    is_support: Vec<bool>,
    position: Vec<Vec4>,
    velocity: Vec<Vec4>,
    acceleration: Vec<Vec4>,
    force: Vec<Vec4>,
    deformation: Vec<Columns>,
    /// `P A^-1`.
    corrected_stress: Vec<Columns>,
}

impl Simulation {
    fn new(cells: &[Cell]) -> Self {
        let n = cells.len();
        let among = Neighbours::among(cells);
        // Coordinates from the least corner: large ones would cost digits, and translation must not matter.
        let origin = Bounds::of(cells.iter().copied()).map_or(Cell::new(0, 0, 0), |b| b.min);
        let place = |c: &Cell| [c.x - origin.x, c.y - origin.y, c.z - origin.z].map(f64::from);
        let rest: Vec<Vector3<f64>> = cells.iter().map(|c| Vector3::from(place(c))).collect();
        let mut neighbours = Vec::with_capacity(among.of.len());
        let mut moment_inverse = Vec::with_capacity(n);
        let mut singular_moment = Vec::new();
        let mut is_sloped = false;
        for i in 0..n {
            let gradients = || {
                among.of[among.range(i)].iter().map(|&j| {
                    let reference = rest[j as usize] - rest[i];
                    (j, reference, kernel_gradient(&reference))
                })
            };
            let moment: Matrix3<f64> =
                gradients().map(|(_, reference, gradient)| reference * gradient.transpose()).sum();
            let inverse = inverse_or_pseudo_inverse(&moment);
            for (to, _, gradient) in gradients() {
                neighbours.push(Neighbour { to, weight: (inverse.transpose() * gradient).into() });
            }
            moment_inverse.push(inverse);
            let flatness = flatness(&moment);
            is_sloped |= flatness == Flatness::Sloped;
            if flatness != Flatness::Full {
                singular_moment.extend(u32::try_from(i));
            }
        }
        Self {
            start: among.start,
            neighbours,
            pairs: Pairs::among(cells),
            materials: Materials::new(&moment_inverse),
            singular_moment,
            is_sloped,
            is_support: cells.iter().map(|c| c.y == origin.y).collect(),
            position: rest.iter().map(|x| [x[0], x[1], x[2], 0.0]).collect(),
            velocity: vec![[0.0; 4]; n],
            acceleration: vec![[0.0; 4]; n],
            force: vec![[0.0; 4]; n],
            deformation: vec![[[0.0; 4]; 3]; n],
            corrected_stress: vec![[[0.0; 4]; 3]; n],
        }
    }

    fn advance(&mut self, from: u32, steps: u32) {
        advance(self, from, steps);
    }

    fn outcome(self, cells: &[Cell]) -> Outcome {
        let (mut degenerate, mut non_finite) = (0, 0);
        let von_mises_pa: Vec<f64> = (0..cells.len())
            .map(|i| {
                let f = Matrix3::from_fn(|row, column| self.deformation[i][column][row]);
                let jacobian = f.determinant();
                if !jacobian.is_finite() {
                    non_finite += 1;
                    0.0
                } else if jacobian.abs() < DEGENERATE_JACOBIAN {
                    degenerate += 1;
                    0.0
                } else {
                    von_mises(&(self.materials.stress(i) * f.transpose() / jacobian))
                }
            })
            .collect();
        let is_number = von_mises_pa.iter().all(|stress| !stress.is_nan());
        let greatest = von_mises_pa.iter().copied().fold(0.0, f64::max);
        let most_stressed = von_mises_pa.iter().position(|stress| *stress == greatest && greatest > 0.0);
        let repeated_cells = cells.len() - cells.iter().collect::<std::collections::HashSet<_>>().len();
        let order_sensitive = self.is_sloped || repeated_cells > 0 || !is_number || non_finite > 0;
        Outcome {
            max_von_mises_pa: if is_number { greatest } else { f64::NAN },
            von_mises_pa,
            most_stressed,
            singular_moment: self.singular_moment,
            degenerate,
            non_finite,
            repeated_cells,
            order_sensitive,
        }
    }
}

/// Steps of the published integrator. Its forces are those of the positions before a step, so they lag one step behind a
/// velocity Verlet scheme; scores depend on it.
///
/// Compiled for several processors; the running one's version is chosen when called. None contracts products and sums,
/// so all give the same bits.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn advance(simulation: &mut Simulation, from: u32, steps: u32) {
    for step in from..from + steps {
        simulation.update_deformation();
        simulation.materials.update(&simulation.deformation, &mut simulation.corrected_stress, STEP_S);
        simulation.force.fill([0.0, -WEIGHT_N * (f64::from(step) / RAMP_STEPS).min(1.0), 0.0, 0.0]);
        let field = Field {
            position: &simulation.position,
            deformation: &simulation.deformation,
            corrected_stress: &simulation.corrected_stress,
        };
        simulation.pairs.add_forces(field, &mut simulation.force);
        simulation.integrate();
    }
}

impl Simulation {
    #[inline(always)]
    fn update_deformation(&mut self) {
        for (i, f) in self.deformation.iter_mut().enumerate() {
            let own = self.position[i];
            let mut columns: Columns = [[0.0; 4]; 3];
            for neighbour in &self.neighbours[self.start[i]..self.start[i + 1]] {
                let other = &self.position[neighbour.to as usize];
                let away: Vec4 = std::array::from_fn(|k| other[k] - own[k]);
                for (column, weight) in columns.iter_mut().zip(neighbour.weight) {
                    for k in 0..4 {
                        column[k] += away[k] * weight;
                    }
                }
            }
            *f = columns;
        }
    }

    #[inline(always)]
    fn integrate(&mut self) {
        for i in 0..self.position.len() {
            if self.is_support[i] {
                continue;
            }
            for k in 0..4 {
                let half_way = self.velocity[i][k] + self.acceleration[i][k] * (STEP_S / 2.0);
                self.position[i][k] += half_way * STEP_S;
                self.acceleration[i][k] = self.force[i][k] / MASS_KG;
                self.velocity[i][k] = half_way + self.acceleration[i][k] * (STEP_S / 2.0);
            }
        }
    }
}

/// Von Mises stress of a Cauchy stress tensor.
fn von_mises(cauchy: &Matrix3<f64>) -> f64 {
    let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
    (1.5 * deviator.norm_squared()).sqrt()
}
