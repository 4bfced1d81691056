//! A plane in front of the camera: its 1/z is linear in (1, x, y). Fits it by least squares, and returns the
//! residuals of other values.

use super::block::Block;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Returns the coefficients of 1, x and y through these values; `None` if the directions determine none.
pub(super) fn fit(values: impl IntoIterator<Item = ([f64; 2], f64)>) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ([x, y], value) in values {
        let row = Vector3::new(1.0, x, y);
        normal += row * row.transpose();
        right += row * value;
    }
    normal.cholesky().map(|found| found.solve(&right))
}

/// Returns the plane's value at a direction.
pub(super) fn value_at(plane: &Vector3<f64>, [x, y]: [f64; 2]) -> f64 {
    plane.dot(&Vector3::new(1.0, x, y))
}

/// Returns the changes of these blocks' depths for a change of each coefficient, mm.
pub(super) fn depths(blocks: &[Block]) -> DMatrix<f64> {
    DMatrix::from_fn(blocks.len(), 3, |row, column| {
        let Block { direction: [x, y], per_depth, .. } = blocks[row];
        [1.0, x, y][column] / per_depth.powi(2)
    })
}

/// Removes every linear combination of a few columns.
pub(super) struct Projection(DMatrix<f64>);

impl Projection {
    /// Makes the projection that removes these columns.
    pub fn orthogonal_to(columns: DMatrix<f64>) -> Self {
        Projection(columns.qr().q())
    }

    /// Returns the residual of each column.
    pub fn residual_of(&self, values: &DMatrix<f64>) -> DMatrix<f64> {
        values - &self.0 * (self.0.transpose() * values)
    }

    /// Returns the trace of a covariance that remains after the projection.
    pub fn projected_trace(&self, covariance: &DMatrix<f64>) -> f64 {
        covariance.trace() - (self.0.transpose() * covariance * &self.0).trace()
    }
}
