//! The published method: a total-Lagrangian SPH simulation of the structure settling under its own weight (SPEC 4).

use nalgebra::{Matrix3, Vector3};

use super::Stopped;
use super::neighbours::{Neighbours, REACH, kernel, kernel_gradient};
use super::small_matrix::{Flatness, flatness, inverse_or_pseudo_inverse};
use crate::voxel::{Bounds, Cell};

/// Young's modulus, Pa.
const YOUNG_PA: f64 = 1e9;
/// Poisson's ratio.
const POISSON: f64 = 0.4;
/// First Lame parameter in the published (not the usual three-dimensional) form, Pa.
const LAMBDA_PA: f64 = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - POISSON));
/// Second Lame parameter, Pa.
const MU_PA: f64 = YOUNG_PA / (2.0 * (1.0 + POISSON));
/// Viscosity, Pa s.
const VISCOSITY: f64 = 1e7;
/// Strength of the hourglass control, Pa.
const HOURGLASS_PA: f64 = 1e8;
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
    for step in 0..STEPS {
        if step % STEPS_PER_LOOK == 0 && stop() {
            return Err(Stopped);
        }
        simulation.step(step);
    }
    Ok(simulation.outcome(cells))
}

/// A directed neighbour as the step loop needs it.
#[derive(Debug, Clone, Copy)]
struct Edge {
    to: usize,
    /// `R = X_j - X_i`.
    reference: Vector3<f64>,
    /// `grad W(R)`.
    gradient: Vector3<f64>,
    /// `0.5 * 1e8 * W / R^3`.
    hourglass: f64,
}

struct Simulation {
    neighbours: Neighbours,
    edges: Vec<Edge>,
    moment_inverse: Vec<Matrix3<f64>>,
    singular_moment: Vec<u32>,
    /// Whether some neighbourhood is flat in a plane or line that is not one of the axes'.
    is_sloped: bool,
    is_support: Vec<bool>,
    rest: Vec<Vector3<f64>>,
    position: Vec<Vector3<f64>>,
    velocity: Vec<Vector3<f64>>,
    acceleration: Vec<Vector3<f64>>,
    force: Vec<Vector3<f64>>,
    deformation: Vec<Matrix3<f64>>,
    /// First Piola-Kirchhoff stress P.
    stress: Vec<Matrix3<f64>>,
    /// `P A^-1`.
    corrected_stress: Vec<Matrix3<f64>>,
}

impl Simulation {
    fn new(cells: &[Cell]) -> Self {
        let n = cells.len();
        let neighbours = Neighbours::among(cells);
        // Coordinates from the least corner: large ones would cost digits, and translation must not matter.
        let origin = Bounds::of(cells.iter().copied()).map_or(Cell::new(0, 0, 0), |b| b.min);
        let rest: Vec<Vector3<f64>> = cells
            .iter()
            .map(|c| Vector3::new(f64::from(c.x - origin.x), f64::from(c.y - origin.y), f64::from(c.z - origin.z)))
            .collect();
        let mut edges = Vec::with_capacity(neighbours.of.len());
        let mut moment_inverse = Vec::with_capacity(n);
        let mut singular_moment = Vec::new();
        let mut is_sloped = false;
        for i in 0..n {
            let mut moment = Matrix3::zeros();
            for &j in &neighbours.of[neighbours.range(i)] {
                let reference = rest[j as usize] - rest[i];
                let gradient = kernel_gradient(&reference);
                let distance = reference.norm();
                debug_assert!(distance < REACH);
                let hourglass = 0.5 * HOURGLASS_PA * kernel(distance) / distance.powi(3);
                edges.push(Edge { to: j as usize, reference, gradient, hourglass });
                moment += reference * gradient.transpose();
            }
            let (inverse, _) = inverse_or_pseudo_inverse(&moment);
            moment_inverse.push(inverse);
            match flatness(&moment) {
                Flatness::Full => {}
                Flatness::AlongAxes => singular_moment.extend(u32::try_from(i)),
                Flatness::Sloped => {
                    singular_moment.extend(u32::try_from(i));
                    is_sloped = true;
                }
            }
        }
        Self {
            neighbours,
            edges,
            moment_inverse,
            singular_moment,
            is_sloped,
            is_support: cells.iter().map(|c| c.y == origin.y).collect(),
            position: rest.clone(),
            rest,
            velocity: vec![Vector3::zeros(); n],
            acceleration: vec![Vector3::zeros(); n],
            force: vec![Vector3::zeros(); n],
            deformation: vec![Matrix3::identity(); n],
            stress: vec![Matrix3::zeros(); n],
            corrected_stress: vec![Matrix3::zeros(); n],
        }
    }

    /// One step of the published integrator. Its forces are those of the positions before the step, so they lag one
    /// step behind a velocity Verlet scheme; scores depend on it.
    fn step(&mut self, step: u32) {
        self.update_stress();
        let load = Vector3::new(0.0, -WEIGHT_N * (f64::from(step) / RAMP_STEPS).min(1.0), 0.0);
        for i in 0..self.rest.len() {
            self.force[i] = self.internal_force(i) + load;
        }
        for i in 0..self.rest.len() {
            if self.is_support[i] {
                continue;
            }
            self.velocity[i] += self.acceleration[i] * (STEP_S / 2.0);
            self.position[i] += self.velocity[i] * STEP_S;
            self.acceleration[i] = self.force[i] / MASS_KG;
            self.velocity[i] += self.acceleration[i] * (STEP_S / 2.0);
        }
    }

    /// Deformation gradient and first Piola-Kirchhoff stress of every particle at its present position.
    fn update_stress(&mut self) {
        for i in 0..self.rest.len() {
            let mut sum = Matrix3::zeros();
            for edge in &self.edges[self.neighbours.range(i)] {
                sum += (self.position[edge.to] - self.position[i]) * edge.gradient.transpose();
            }
            let f = sum * self.moment_inverse[i];
            let rate = (f - self.deformation[i]) / STEP_S;
            self.deformation[i] = f;
            self.stress[i] = piola_stress(&f, &rate);
            self.corrected_stress[i] = self.stress[i] * self.moment_inverse[i];
        }
    }

    fn internal_force(&self, i: usize) -> Vector3<f64> {
        let mut force = Vector3::zeros();
        let (f, own) = (self.deformation[i], self.corrected_stress[i]);
        for edge in &self.edges[self.neighbours.range(i)] {
            let j = edge.to;
            force += (own + self.corrected_stress[j]) * edge.gradient;
            let r = self.position[j] - self.position[i];
            let length = r.norm();
            let surplus_i = (f * edge.reference - r).dot(&r) / length;
            let surplus_j = (r - self.deformation[j] * edge.reference).dot(&-r) / length;
            force += r * (-edge.hourglass * (surplus_i + surplus_j) / length);
        }
        force
    }

    fn outcome(self, cells: &[Cell]) -> Outcome {
        let (mut degenerate, mut non_finite) = (0, 0);
        let von_mises_pa: Vec<f64> = self
            .deformation
            .iter()
            .zip(&self.stress)
            .map(|(f, p)| {
                let jacobian = f.determinant();
                if !jacobian.is_finite() {
                    non_finite += 1;
                    0.0
                } else if jacobian.abs() < DEGENERATE_JACOBIAN {
                    degenerate += 1;
                    0.0
                } else {
                    von_mises(&(p * f.transpose() / jacobian))
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

/// `P = F S + 2 J eta d' F^-T` for a deformation gradient and its rate.
fn piola_stress(f: &Matrix3<f64>, rate: &Matrix3<f64>) -> Matrix3<f64> {
    let strain = (f.transpose() * f - Matrix3::identity()) * 0.5;
    let elastic = Matrix3::identity() * (LAMBDA_PA * strain.trace()) + strain * (2.0 * MU_PA);
    let (f_inverse, _) = inverse_or_pseudo_inverse(f);
    let gradient = rate * f_inverse;
    let symmetric = (gradient + gradient.transpose()) * 0.5;
    let deviator = symmetric - Matrix3::identity() * (symmetric.trace() / 3.0);
    f * elastic + deviator * f_inverse.transpose() * (2.0 * f.determinant() * VISCOSITY)
}

/// Von Mises stress of a Cauchy stress tensor.
fn von_mises(cauchy: &Matrix3<f64>) -> f64 {
    let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
    (1.5 * deviator.norm_squared()).sqrt()
}
