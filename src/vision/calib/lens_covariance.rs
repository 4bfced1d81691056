//! How well pictures determine a lens: the covariance of its nine parameters, with the boards' poses eliminated.
//!
//! With J the derivatives of all corners with respect to the lens and Jᵢ those with respect to the pose of picture i,
//!     C = σ² (Σ Jᵀ J − Σ Jᵀ Jᵢ (Jᵢᵀ Jᵢ)⁻¹ Jᵢᵀ J + σ² D)⁻¹.                                                      (1)
//! A mount needs the whole of C, since principal point, tangential distortion and focal length are far from
//! independent. D is the prior knowledge of any lens: no coefficient moves the picture's rim by more than a stated
//! share of its radius, the principal point lies near the picture's middle, the focal lengths are nearly equal. This
//! knowledge has an effect only if the pictures carry no information. All five coefficients are in (1) with every
//! model, since a coefficient that was left out is not known to be zero. σ² is that of the left-out pictures, if it is
//! the larger. OpenCV states only the roots of C's diagonal, and these roots are too large by a factor of √2 or a
//! little more: OpenCV's σ² divides by the number of corners, although each corner has two rows.

use super::adjust::scaled_inverse;
use super::lens_fit::prior_residuals;
use super::lens_gram::LensGram;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::LensCovariance;

/// Standard deviation of the displacement of the rim by radial terms, as a share of its radius.
const RADIAL_SHARE: f64 = 0.2;
/// Standard deviation of the displacement of the rim by tangential terms, as a share of its radius: lenses of one
/// maker differ by a thousandth.
const TANGENTIAL_PRIOR_SHARE: f64 = 0.01;

/// Returns the information of corners and prior together, in units of `variance_px2`; `None` if a picture
/// determines no pose.
pub(super) fn information(camera: &PinholeCamera, grams: &[LensGram], variance_px2: f64) -> Option<LensCovariance> {
    let mut normal = LensCovariance::zeros();
    for gram in grams {
        normal += gram.information()?;
    }
    let radius = camera.max_undistorted_radius(0.0)?;
    for (place, power, share) in [
        (4, 2, RADIAL_SHARE),
        (5, 4, RADIAL_SHARE),
        (6, 1, TANGENTIAL_PRIOR_SHARE),
        (7, 1, TANGENTIAL_PRIOR_SHARE),
        (8, 6, RADIAL_SHARE),
    ] {
        let deviation = share / radius.powi(power);
        normal[(place, place)] += variance_px2 / deviation.powi(2);
    }
    for (_, by_lens) in prior_residuals(camera) {
        normal += by_lens * by_lens.transpose() * variance_px2;
    }
    Some(normal)
}

/// C of (1).
pub(super) fn lens_covariance(information: &LensCovariance, variance_px2: f64) -> Option<LensCovariance> {
    Some(scaled_inverse(information)? * variance_px2)
}
