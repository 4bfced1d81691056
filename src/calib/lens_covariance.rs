//! How well pictures determine a lens: the covariance of its nine numbers, boards' poses eliminated.
//!
//! With J the slopes of all corners in the lens and Jᵢ in the pose of picture i,
//!     C = σ² (Σ Jᵀ J − Σ Jᵀ Jᵢ (Jᵢᵀ Jᵢ)⁻¹ Jᵢᵀ J)⁻¹,   σ² = Σ v² / (rows − 9 − 6 pictures).                       (1)
//! A mount needs C whole, since principal point, tangential distortion and focal length are far from independent. OpenCV
//! states the roots of its diagonal only, and those √2 too large or a little more: its σ² divides by corners where each
//! has two rows.

use super::adjust::scaled_inverse;
use super::detect::Corners;
use crate::cell::LensCovariance;
use crate::geometry::{Board, Camera, PinholeCamera, Rigid};
use nalgebra::{Matrix6, SMatrix};

/// `None` where the pictures do not determine the lens.
pub(super) fn lens_covariance(
    camera: &PinholeCamera,
    views: &[(&Corners, Rigid<Camera, Board>)],
) -> Option<LensCovariance> {
    let (mut normal, mut square, mut rows) = (LensCovariance::zeros(), 0.0, 0.0);
    for (corners, camera_from_board) in views {
        let turn = camera_from_board.rotation().into_inner();
        let (mut lens, mut cross, mut pose) =
            (LensCovariance::zeros(), SMatrix::<f64, 9, 6>::zeros(), Matrix6::zeros());
        for (q, found) in corners.iter() {
            let point = *camera_from_board * *q;
            let (pixel, slope) = camera.project_with_slope(point)?;
            let by_lens = camera.lens_slope(point)?;
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(-slope * turn * q.mm.coords.cross_matrix()));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&(slope * turn));
            lens += by_lens.transpose() * by_lens;
            cross += by_lens.transpose() * by_pose;
            pose += by_pose.transpose() * by_pose;
            square += pixel.distance_px(*found).powi(2);
            rows += 2.0;
        }
        normal += lens - cross * scaled_inverse(&pose)? * cross.transpose();
    }
    let redundancy = rows - 9.0 - 6.0 * views.len() as f64;
    (redundancy > 0.0).then_some(scaled_inverse(&normal)? * (square / redundancy))
}
