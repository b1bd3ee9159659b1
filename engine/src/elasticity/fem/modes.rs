//! Stiffness of a block by the symmetry of the cube.
//!
//! The cube is its own mirror image along each axis. So the forces for displacements that are even or odd along each axis
//! are even or odd in the same way. Sums and differences over opposite corners take the displacements of the corners to
//! such parts, and the 24 equations to eight sets of three. That is less than half the work, and a displacement of all
//! corners alike causes no force at all, not even by rounding.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use nalgebra::SMatrix;
use pulp::Simd;

use super::element::UNKNOWNS;
use super::shares::Corners;
use crate::elasticity::lanes::{Lanes, MAX_LANES};

/// Fraction of the greatest entry up to which an entry is what rounding leaves of zero.
const ROUNDING: f64 = 1e-12;

/// Stiffness of a block among even and odd parts of the displacements.
#[derive(Debug)]
pub struct Modes {
    /// For each symmetry, three equations of three unknowns. In symmetry `s`, component `k` has the part whose bit for each
    /// axis, 1 if it is odd along that axis, is that of `s ^ 1 << k`.
    stiffness: [[[f64; 3]; 3]; 8],
}

impl Modes {
    /// Takes the stiffness of a block, by corners and components.
    #[must_use]
    pub fn new(stiffness: &SMatrix<f64, UNKNOWNS, UNKNOWNS>) -> Self {
        let sign = |part: usize, corner: usize| if (part & corner).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
        // The transformation of the displacements, and that of the forces, which is the same, each eight times too large.
        let entry = |(k, part): (usize, usize), (l, other): (usize, usize)| {
            let corners = (0..8).flat_map(|a| (0..8).map(move |b| (a, b)));
            let terms = corners.map(|(a, b)| sign(part, a) * stiffness[(3 * a + k, 3 * b + l)] * sign(other, b));
            terms.sum::<f64>() / 64.0
        };
        let greatest = stiffness.amax();
        let equations = |symmetry: usize| {
            [0, 1, 2].map(|k| {
                [0, 1, 2].map(|l| {
                    let entry = entry((k, symmetry ^ 1 << k), (l, symmetry ^ 1 << l));
                    if entry.abs() > ROUNDING * greatest { entry } else { 0.0 }
                })
            })
        };
        Self { stiffness: std::array::from_fn(equations) }
    }

    /// Returns the forces on the corners for displacements of them: components, each by corners.
    #[inline(always)]
    pub fn forces<S: Simd>(&self, simd: S, mut moved: [[Lanes<S>; 8]; 3]) -> [[Lanes<S>; 8]; 3] {
        for component in &mut moved {
            transform(component);
        }
        let mut pulled = moved;
        for (symmetry, stiffness) in self.stiffness.iter().enumerate() {
            let part = |k: usize| symmetry ^ 1 << k;
            for k in 0..3 {
                let entry = |l: usize| Lanes::splat(simd, stiffness[k][l]);
                let own = entry(0) * moved[0][part(0)];
                let own = entry(1).mul_add(moved[1][part(1)], own);
                pulled[k][part(k)] = entry(2).mul_add(moved[2][part(2)], own);
            }
        }
        for component in &mut pulled {
            transform(component);
        }
        pulled
    }
}

/// Takes the values at the corners to their even and odd parts along each axis, times eight, or back.
#[inline(always)]
fn transform<S: Simd>(values: &mut [Lanes<S>; 8]) {
    for axis in [1, 2, 4] {
        for corner in 0..8 {
            if corner & axis == 0 {
                let (near, far) = (values[corner], values[corner | axis]);
                values[corner] = near + far;
                values[corner | axis] = near - far;
            }
        }
    }
}

/// Adds the forces of blocks to those on their nodes. `place` returns where in `force` a node has its three entries.
#[inline(always)]
pub fn add<S: Simd>(
    simd: S,
    blocks: &[Corners],
    modes: &Modes,
    displacement: &[f64],
    force: &mut [f64],
    place: impl Fn(u32) -> usize,
) {
    for blocks in blocks.chunks(S::F64_LANES) {
        let forces = forces(simd, blocks, modes, |node, k| displacement[3 * node as usize + k]);
        for (lane, nodes) in blocks.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                let at = place(node);
                for (sum, of_corners) in force[at..at + 3].iter_mut().zip(&forces) {
                    *sum += of_corners[corner][lane];
                }
            }
        }
    }
}

/// Returns the forces on the corners of up to as many blocks as there are lanes, for the displacements of nodes: by
/// components and corners, a block in each lane.
#[inline(always)]
pub fn forces<S: Simd>(
    simd: S,
    blocks: &[Corners],
    modes: &Modes,
    displacement: impl Fn(u32, usize) -> f64,
) -> [[[f64; MAX_LANES]; 8]; 3] {
    // Lanes without a block take the first one's.
    let nodes: [&Corners; MAX_LANES] = std::array::from_fn(|lane| blocks.get(lane).unwrap_or(&blocks[0]));
    let moved = |k: usize, corner: usize| {
        let lanes: [f64; MAX_LANES] = std::array::from_fn(|lane| displacement(nodes[lane][corner], k));
        Lanes::load(simd, &lanes, 0)
    };
    let pulled = modes.forces(simd, std::array::from_fn(|k| std::array::from_fn(|corner| moved(k, corner))));
    let mut forces = [[[0.0; MAX_LANES]; 8]; 3];
    for (of_corners, pulled) in forces.iter_mut().zip(pulled) {
        for (lanes, pulled) in of_corners.iter_mut().zip(pulled) {
            pulled.store(lanes, 0);
        }
    }
    forces
}

#[cfg(test)]
mod tests {
    use nalgebra::SVector;
    use pulp::Scalar;

    use super::*;
    use crate::elasticity::fem::ELEMENT;

    #[test]
    fn the_forces_are_those_of_the_stiffness() {
        let modes = Modes::new(&ELEMENT.stiffness);
        let moved = SVector::<f64, UNKNOWNS>::from_fn(|i, _| (i as f64).sin());
        let expected = ELEMENT.stiffness * moved;
        let lanes = [0, 1, 2].map(|k| std::array::from_fn(|corner| Lanes::splat(Scalar, moved[3 * corner + k])));
        let forces = |moved: [[Lanes<Scalar>; 8]; 3]| {
            modes.forces(Scalar, moved).map(|component| {
                component.map(|force| {
                    let mut number = [0.0];
                    force.store(&mut number, 0);
                    number[0]
                })
            })
        };
        let found = forces(lanes);
        for (i, expected) in expected.iter().enumerate() {
            assert!((found[i % 3][i / 3] - expected).abs() < 1e-12 * ELEMENT.stiffness.amax(), "{i}");
        }
        let along_y = [0.0, 0.3, 0.0].map(|moved| [Lanes::splat(Scalar, moved); 8]);
        assert_eq!(forces(along_y), [[0.0; 8]; 3]);
    }
}
