//! The eight-node hexahedron with incompatible modes, for a cube.
//!
//! Each of the three components has, in addition to the trilinear displacements, the internal modes `1 - xi^2`, `1 -
//! eta^2` and `1 - zeta^2` (Wilson et al. 1973; Taylor, Beresford and Wilson 1976). With them a cube bends without the
//! shear that trilinear displacements alone would need, so a part one block thick does not lock. All blocks are equal
//! cubes, for which the element passes the patch test as it is. The modes belong to one element each and are
//! eliminated; as is usual for them, weight acts on the corners alone.

use std::sync::LazyLock;

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen};

use crate::elasticity::{POISSON, YOUNG_PA};

/// Number of displacements of the eight corners: x, y, z of each.
pub const UNKNOWNS: usize = 24;
/// Number of internal modes: three for each component.
const MODES: usize = 9;
/// Number of integration points.
pub const POINTS: usize = 8;

/// Corners of the cube, in edges; x varies fastest.
pub const CORNERS: [[i32; 3]; 8] =
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];

/// Components of strain or stress: xx, yy, zz, and shear xy, yz, zx.
type Six = SVector<f64, 6>;

/// Matrices of a cube with edge 1 m. A cube with edge `h` has `h` times the stiffness, and its stress is that of the
/// displacements divided by `h`.
#[derive(Debug)]
pub struct Element {
    /// Stiffness matrix: forces on the corners per displacement of the corners, N/m.
    pub stiffness: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// Greatest eigenvalue of the stiffness divided by its diagonal, whose entries are all equal. It bounds the eigenvalues of
    /// any structure of such cubes with each equation divided by its diagonal.
    pub greatest: f64,
    /// Stress at each integration point per displacement of the corners, Pa/m.
    stress: [SMatrix<f64, 6, UNKNOWNS>; POINTS],
}

/// Element of a block, computed once.
pub static ELEMENT: LazyLock<Element> = LazyLock::new(|| Element::new(YOUNG_PA, POISSON));

impl Element {
    /// Computes the element of a material with this Young's modulus, Pa, and this Poisson's ratio.
    #[must_use]
    pub fn new(young_pa: f64, poisson: f64) -> Self {
        Self::with_modes(young_pa, poisson, true)
    }

    /// Computes the element with or without the internal modes.
    fn with_modes(young_pa: f64, poisson: f64, has_modes: bool) -> Self {
        let elasticity = elasticity(young_pa, poisson);
        // Two points in each direction integrate all products here exactly.
        let points = CORNERS.map(|corner| corner.map(|c| f64::from(2 * c - 1) / 3.0_f64.sqrt()));
        let weight = 1.0 / POINTS as f64;
        let strains = points.map(|point| (corner_strain(point), mode_strain(point)));
        let mut corners = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut mixed = SMatrix::<f64, MODES, UNKNOWNS>::zeros();
        let mut modes = SMatrix::<f64, MODES, MODES>::zeros();
        for (b, g) in &strains {
            corners += b.transpose() * elasticity * b * weight;
            mixed += g.transpose() * elasticity * b * weight;
            modes += g.transpose() * elasticity * g * weight;
        }
        // Eliminate the modes by modes * a = -mixed * u. The matrix of the modes is positive definite.
        let inverse = modes.try_inverse().filter(|_| has_modes).unwrap_or_else(SMatrix::zeros);
        let follow = inverse * mixed;
        let stiffness = corners - mixed.transpose() * follow;
        Self {
            stiffness,
            greatest: SymmetricEigen::new(stiffness / stiffness[(0, 0)]).eigenvalues.max(),
            stress: strains.map(|(b, g)| elasticity * (b - g * follow)),
        }
    }

    /// Returns the von Mises stress at the integration points, Pa, of a cube with edge `edge_m` whose corners are
    /// displaced by `displacement` (m).
    #[must_use]
    pub fn von_mises(&self, displacement: &SVector<f64, UNKNOWNS>, edge_m: f64) -> [f64; POINTS] {
        self.stress.map(|stress| von_mises(&(stress * displacement / edge_m)))
    }
}

/// Returns the elasticity matrix from strain to stress, Pa, with the Lame parameters of three dimensions.
fn elasticity(young_pa: f64, poisson: f64) -> SMatrix<f64, 6, 6> {
    let lambda = young_pa * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    let mu = young_pa / (2.0 * (1.0 + poisson));
    let mut elasticity = SMatrix::<f64, 6, 6>::zeros();
    elasticity.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::repeat(lambda) + Matrix3::identity() * (2.0 * mu)));
    elasticity.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * mu));
    elasticity
}

/// Returns the strain at a point (coordinates -1 to 1) per displacement of the corners.
fn corner_strain(point: [f64; 3]) -> SMatrix<f64, 6, UNKNOWNS> {
    let mut strain = SMatrix::zeros();
    for (i, corner) in CORNERS.iter().enumerate() {
        let sign = corner.map(|c| f64::from(2 * c - 1));
        let factor: [f64; 3] = std::array::from_fn(|k| f64::midpoint(1.0, sign[k] * point[k]));
        let gradient =
            [sign[0] * factor[1] * factor[2], sign[1] * factor[0] * factor[2], sign[2] * factor[0] * factor[1]];
        put_gradient(&mut strain, 3 * i, gradient);
    }
    strain
}

/// Returns the strain at a point per amplitude of the internal modes; the gradient of `1 - xi^2` is `-4 xi` per edge.
fn mode_strain(point: [f64; 3]) -> SMatrix<f64, 6, MODES> {
    let mut strain = SMatrix::zeros();
    for k in 0..3 {
        let mut gradient = [0.0; 3];
        gradient[k] = -4.0 * point[k];
        put_gradient(&mut strain, 3 * k, gradient);
    }
    strain
}

/// Writes the strain of a function with this gradient, as displacement in x, y and z, into three columns.
fn put_gradient<const N: usize>(strain: &mut SMatrix<f64, 6, N>, column: usize, [x, y, z]: [f64; 3]) {
    let entries = [(0, 0, x), (3, 0, y), (5, 0, z), (1, 1, y), (3, 1, x), (4, 1, z), (2, 2, z), (4, 2, y), (5, 2, x)];
    for (row, component, value) in entries {
        strain[(row, column + component)] = value;
    }
}

/// Returns the von Mises stress of the components xx, yy, zz, xy, yz, zx.
fn von_mises(s: &Six) -> f64 {
    let normal = (s[0] - s[1]).powi(2) + (s[1] - s[2]).powi(2) + (s[2] - s[0]).powi(2);
    (0.5 * normal + 3.0 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5])).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(f: impl Fn([f64; 3]) -> [f64; 3]) -> SVector<f64, UNKNOWNS> {
        SVector::from_iterator(CORNERS.iter().flat_map(|corner| f(corner.map(f64::from))))
    }

    #[test]
    fn rigid_motion_needs_no_force_and_has_no_stress() {
        let turn = field(|[x, y, z]| [0.3 - 0.2 * y + 0.1 * z, 1.0 + 0.2 * x - 0.7 * z, -2.0 - 0.1 * x + 0.7 * y]);
        assert!((ELEMENT.stiffness * turn).norm() < 1e-6 * ELEMENT.stiffness.norm() * 1e-6);
        assert!(ELEMENT.von_mises(&turn, 1.0).iter().all(|stress| *stress < 1e-6));
    }

    #[test]
    fn the_stiffness_is_symmetric_with_six_rigid_motions_and_no_other_free_one() {
        let k = &ELEMENT.stiffness;
        assert!((k - k.transpose()).norm() < 1e-12 * k.norm());
        let values = k.symmetric_eigenvalues();
        let greatest = values.max();
        assert_eq!(values.iter().filter(|value| value.abs() < 1e-10 * greatest).count(), 6);
        assert!(values.iter().all(|value| *value > -1e-10 * greatest));
    }

    /// Bends a cube purely: `u_x = x y, u_y = (-x^2 - nu y^2 + nu z^2) / 2, u_z = -nu y z`, from the middle. Without
    /// the modes a cube would lock: it would be three quarters stiffer.
    #[test]
    fn bending_takes_the_energy_of_a_beam() {
        let middle = |c: [f64; 3]| c.map(|x| x - 0.5);
        let bent = field(|c| {
            let [x, y, z] = middle(c);
            [x * y, -x * x / 2.0 - POISSON * (y * y - z * z) / 2.0, -POISSON * y * z]
        });
        let of_a_beam = YOUNG_PA / 12.0 / 2.0;
        let energy = |element: &Element| (bent.transpose() * element.stiffness * bent)[0] / 2.0 / of_a_beam;
        assert!((energy(&ELEMENT) - 1.0).abs() < 1e-12, "{} of a beam's", energy(&ELEMENT));
        let locked = energy(&Element::with_modes(YOUNG_PA, POISSON, false));
        assert!((locked - 1.757).abs() < 1e-3, "{locked} of a beam's without modes");
    }
}
