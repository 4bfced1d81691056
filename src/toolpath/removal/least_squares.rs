//! A linear model fitted by least squares, with the values needed for its covariance.

use nalgebra::{DMatrix, DVector};

/// Result of a least-squares fit.
pub(super) struct Line {
    /// The estimated parameters.
    pub solution: DVector<f64>,
    /// (AᵀA)⁻¹.
    pub inverse: DMatrix<f64>,
    /// Standard deviation of one y from the model.
    pub deviation: f64,
}

/// Returns the x that minimises |A x − y|², with these rows of A; `None` if they do not determine x.
pub(super) fn line(rows: &DMatrix<f64>, y: &DVector<f64>) -> Option<Line> {
    let inverse = (rows.transpose() * rows).try_inverse()?;
    let solution = &inverse * rows.transpose() * y;
    let left = y - rows * &solution;
    let redundancy = rows.nrows().saturating_sub(rows.ncols()).max(1) as f64;
    Some(Line { solution, inverse, deviation: (left.norm_squared() / redundancy).sqrt() })
}
