//! The normal equations of one picture of a board: the contributions of its corners to the lens's nine parameters and
//! to the board's pose.

use super::adjust::scaled_inverse;
use super::detect::Corners;
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Rigid};
use panelprep_cell::cell::LensCovariance;

/// The products of the derivatives of a picture's corners. The pose is moved on the right, by rotations in rad and
/// shifts in mm.
pub(super) struct LensGram {
    /// Normal matrix of the lens parameters.
    pub lens: LensCovariance,
    /// Cross terms of lens and pose.
    pub lens_pose_cross: SMatrix<f64, 9, 6>,
    /// Normal matrix of the pose.
    pub pose: Matrix6<f64>,
    /// Right-hand side of the lens parameters.
    pub lens_pull: SVector<f64, 9>,
    /// Right-hand side of the pose.
    pub pose_pull: Vector6<f64>,
    /// Sum of squared residuals, px².
    pub square: f64,
    /// Number of residuals: two for each corner.
    pub rows: f64,
}

impl LensGram {
    /// Returns the part of a picture; `None` if a corner lies behind the camera.
    pub fn compute(
        camera: &PinholeCamera,
        corners: &Corners,
        camera_from_board: &Rigid<Camera, Board>,
    ) -> Option<Self> {
        let turn = camera_from_board.rotation().into_inner();
        let mut gram = LensGram {
            lens: LensCovariance::zeros(),
            lens_pose_cross: SMatrix::zeros(),
            pose: Matrix6::zeros(),
            lens_pull: SVector::zeros(),
            pose_pull: Vector6::zeros(),
            square: 0.0,
            rows: 2.0 * corners.len() as f64,
        };
        for (q, found) in corners {
            let point = *camera_from_board * *q;
            let (pixel, slope) = camera.project_with_jacobian(point)?;
            let by_lens = camera.lens_slope(point)?;
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(-slope * turn * q.mm.coords.cross_matrix()));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&(slope * turn));
            let residual = nalgebra::Vector2::new(found.u - pixel.u, found.v - pixel.v);
            gram.lens += by_lens.transpose() * by_lens;
            gram.lens_pose_cross += by_lens.transpose() * by_pose;
            gram.pose += by_pose.transpose() * by_pose;
            gram.lens_pull += by_lens.transpose() * residual;
            gram.pose_pull += by_pose.transpose() * residual;
            gram.square += residual.norm_squared();
        }
        Some(gram)
    }

    /// Returns the picture's information on the lens, with its pose eliminated.
    pub fn information(&self) -> Option<LensCovariance> {
        Some(self.lens - self.lens_pose_cross * scaled_inverse(&self.pose)? * self.lens_pose_cross.transpose())
    }
}
