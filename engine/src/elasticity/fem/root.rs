//! Root of a symmetric block of stiffness among rigid motions: Cholesky's, without the motions that nothing resists.

use nalgebra::{Matrix6, Vector6};

use super::motions::MOTIONS;

/// Fraction of the diagonal up to which a pivot is left out: its motion depends on others, as the rotation of a single
/// node, or so little resists it, as the end of a very long beam, that rounding would decide.
const DEPENDENT: f64 = 1e-9;

/// Lower triangular root. A column of zeros is a motion that is left out.
#[derive(Debug)]
pub struct Root(Matrix6<f64>);

impl Root {
    /// Computes the root of a block. A pivot that is nothing beside `scale`, the diagonal before an elimination, leaves its
    /// motion out.
    #[must_use]
    pub fn new(block: &Matrix6<f64>, scale: &Vector6<f64>) -> Self {
        let mut root = Matrix6::zeros();
        for j in 0..MOTIONS {
            let pivot = block[(j, j)] - (0..j).map(|k| root[(j, k)] * root[(j, k)]).sum::<f64>();
            if pivot <= DEPENDENT * scale[j] {
                continue;
            }
            root[(j, j)] = pivot.sqrt();
            for i in j + 1..MOTIONS {
                let sum: f64 = (0..j).map(|k| root[(i, k)] * root[(j, k)]).sum();
                root[(i, j)] = (block[(i, j)] - sum) / root[(j, j)];
            }
        }
        Self(root)
    }

    /// Multiplies a block by the inverse of the transpose of the root from the right.
    pub fn divide(&self, block: &mut Matrix6<f64>) {
        for j in 0..MOTIONS {
            for i in 0..MOTIONS {
                let sum: f64 = (0..j).map(|k| block[(i, k)] * self.0[(j, k)]).sum();
                block[(i, j)] = self.quotient(block[(i, j)] - sum, j);
            }
        }
    }

    /// Solves the equations of the root in place.
    pub fn solve_forward(&self, own: &mut [f64; MOTIONS]) {
        for i in 0..MOTIONS {
            let sum: f64 = (0..i).map(|j| self.0[(i, j)] * own[j]).sum();
            own[i] = self.quotient(own[i] - sum, i);
        }
    }

    /// Solves the equations of the transpose of the root in place.
    pub fn solve_backward(&self, own: &mut [f64; MOTIONS]) {
        for i in (0..MOTIONS).rev() {
            let sum: f64 = (i + 1..MOTIONS).map(|j| self.0[(j, i)] * own[j]).sum();
            own[i] = self.quotient(own[i] - sum, i);
        }
    }

    /// Returns the inverse of the block, by columns; zeros for motions that are left out.
    #[must_use]
    pub fn inverse(&self) -> [[f64; MOTIONS]; MOTIONS] {
        std::array::from_fn(|column| {
            let mut own = [0.0; MOTIONS];
            own[column] = 1.0;
            self.solve_forward(&mut own);
            self.solve_backward(&mut own);
            own
        })
    }

    /// Divides by a pivot; zero for a motion that is left out.
    fn quotient(&self, of: f64, at: usize) -> f64 {
        let pivot = self.0[(at, at)];
        if pivot > 0.0 { of / pivot } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_that_depends_on_others_is_left_out() {
        let block = Matrix6::from_fn(|i, j| if i == 5 || j == 5 { 0.0 } else { f64::from(u8::from(i == j)) + 1.0 });
        let root = Root::new(&block, &block.diagonal());
        assert!((root.0 * root.0.transpose() - block).norm() < 1e-12);
        let mut divided = block;
        root.divide(&mut divided);
        assert!((divided - root.0).norm() < 1e-12);
        let inverse = Matrix6::from_columns(&root.inverse().map(Vector6::from));
        assert!((block * inverse * block - block).norm() < 1e-12);
        assert!((0..6).all(|k| inverse[(5, k)] == 0.0 && inverse[(k, 5)] == 0.0));
    }
}
