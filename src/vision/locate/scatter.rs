//! Calculates the centroid of points and the direction in which they scatter least.

use nalgebra::{Matrix3, Vector3};

/// Returns the centroid, and the direction in which the points scatter least; `None` for no points.
pub(super) fn centroid_and_normal(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    if points.is_empty() {
        return None;
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    Some((mean, eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()))
}
