//! Steps of smoothing, at some nodes at a time.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::ops::Range;

/// What is done at a node as soon as the forces of all its blocks have been added up: how its vectors change.
#[derive(Debug, Clone, Copy)]
pub enum Step {
    /// Next step of a polynomial, from the last one and from the force that it leaves.
    Next {
        /// Part of the last step.
        of_direction: f64,
        /// Factor of the force that is left, divided by the diagonal.
        of_rest: f64,
    },
    /// First step of a polynomial, after another step, which it adds to the solution.
    First {
        /// Factor of the force that is left, divided by the diagonal.
        of_rest: f64,
    },
    /// Subtraction of what the last step pulls.
    Settle,
    /// What all steps pull, from the force that they leave.
    End {
        /// Whether the last step has yet to be added to the solution.
        adds: bool,
    },
}

impl Step {
    /// Changes the vectors of some nodes, and leaves zeros for their forces.
    #[inline(always)]
    pub fn complete(self, forces: &mut [f64], vectors: Vectors<'_>) {
        let Vectors { force, compliance, direction, rest, solution, pulled } = vectors;
        let unknowns = direction.iter_mut().zip(forces).zip(rest);
        match self {
            Self::Next { of_direction, of_rest } => {
                for ((((direction, by), rest), compliance), solution) in unknowns.zip(compliance).zip(solution) {
                    *rest -= *by;
                    *by = 0.0;
                    *direction = of_direction * *direction + of_rest * compliance * *rest;
                    *solution += *direction;
                }
            }
            Self::First { of_rest } => {
                for ((((direction, by), rest), compliance), solution) in unknowns.zip(compliance).zip(solution) {
                    *rest -= *by;
                    *by = 0.0;
                    *solution += *direction;
                    *direction = of_rest * compliance * *rest;
                    *solution += *direction;
                }
            }
            Self::Settle => {
                for ((_, by), rest) in unknowns {
                    *rest -= *by;
                    *by = 0.0;
                }
            }
            Self::End { adds } => {
                let unknowns = unknowns.zip(compliance).zip(force).zip(pulled);
                for (((((_, by), rest), compliance), force), pulled) in unknowns {
                    *pulled = if *compliance > 0.0 { force - (*rest - *by) } else { 0.0 };
                    *by = 0.0;
                }
                if adds {
                    for (solution, direction) in solution.iter_mut().zip(direction) {
                        *solution += *direction;
                    }
                }
            }
        }
    }
}

/// Vectors of all unknowns, or those of some nodes.
#[derive(Debug)]
pub struct Vectors<'a> {
    /// Force for which the steps are.
    pub force: &'a [f64],
    /// Reciprocal of each unknown's entry on the diagonal; zero for a held node.
    pub compliance: &'a [f64],
    /// Last step.
    pub direction: &'a mut [f64],
    /// Force that the steps leave.
    pub rest: &'a mut [f64],
    /// Sum of the steps.
    pub solution: &'a mut [f64],
    /// What all steps pull.
    pub pulled: &'a mut [f64],
}

impl Vectors<'_> {
    /// Returns the entries of some nodes.
    #[inline(always)]
    pub fn part(&mut self, nodes: Range<usize>) -> Vectors<'_> {
        let unknowns = 3 * nodes.start..3 * nodes.end;
        Vectors {
            force: &self.force[unknowns.clone()],
            compliance: &self.compliance[unknowns.clone()],
            direction: &mut self.direction[unknowns.clone()],
            rest: &mut self.rest[unknowns.clone()],
            solution: &mut self.solution[unknowns.clone()],
            pulled: &mut self.pulled[unknowns],
        }
    }

    /// Splits the vectors into those of the nodes before and from one.
    pub fn split_at(self, node: usize) -> (Self, Self) {
        let at = 3 * node;
        let (force, later_force) = self.force.split_at(at);
        let (compliance, later_compliance) = self.compliance.split_at(at);
        let (direction, later_direction) = self.direction.split_at_mut(at);
        let (rest, later_rest) = self.rest.split_at_mut(at);
        let (solution, later_solution) = self.solution.split_at_mut(at);
        let (pulled, later_pulled) = self.pulled.split_at_mut(at);
        let later = Self {
            force: later_force,
            compliance: later_compliance,
            direction: later_direction,
            rest: later_rest,
            solution: later_solution,
            pulled: later_pulled,
        };
        (Self { force, compliance, direction, rest, solution, pulled }, later)
    }
}
