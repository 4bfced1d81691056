//! The influence of one station, or of a lens error, on an adjustment: to first order, from its normal equations.
//!
//! A station adds its information Λᵢ to Λ = Σ Λᵢ and its gradient gᵢ. Without this station the result moves by −(Λ −
//! Λᵢ)⁻¹ gᵢ; a station that was not part of the adjustment is compared with the result. A lens error δ moves the
//! result by Λ⁻¹ B δ, with B the derivatives of the corners with respect to the lens. A lens of covariance C therefore
//! adds Λ⁻¹ B C Bᵀ Λ⁻¹. This is the largest part if the robot is good: an error of 0.1 px of the principal point
//! rotates the mount by the view angle of 0.1 px.

use super::adjust::{MountAdjustment, prior_weights, scaled_inverse};
use super::arrangement::{Arrangement, Twist, log};
use super::chain::{Chain, MountBoardMatrix, Station};
use nalgebra::{Isometry3, Matrix6, SMatrix, SVector};
use panelprep_base::geometry::{Base, Board, Flange, PinholeCamera, Rigid};
use panelprep_cell::cell::LensCovariance;

/// Returns the inverse covariance that a station adds, and its gradient for mount and board, in rad and mm: used to
/// leave a station out, and to choose the next one.
pub(super) fn information<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    station: &Station<A::From>,
) -> Option<(MountBoardMatrix, SVector<f64, 12>)> {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &Isometry3::identity());
    let gram = chain.gram(camera, &station.observation)?;
    let inverse = (gram.flange() + prior_weights(&adjusted.noise)).cholesky()?.inverse();
    let reduced = gram.mount_and_board() - gram.cross() * inverse * gram.cross().transpose();
    let pull = gram.gradient.fixed_rows::<12>(0) - gram.cross() * inverse * gram.gradient.fixed_rows::<6>(12);
    let weight = adjusted.noise.corner.powi(-2);
    Some((reduced * weight, pull * weight))
}

/// The scatter of an arm itself, as standard deviations: a third of the pose repeatability of a KR 6 R700, ±0.03 mm
/// (data sheet). The rotation, `ARM_TURN_RAD`, causes this shift at 350 mm, half of the arm's reach. Because of this
/// minimum, a few poses that fit better by chance do not make another pose appear wrong.
const ARM_SHIFT_MM: f64 = 0.01;
const ARM_TURN_RAD: f64 = 3e-5;

/// Returns how improbable a station is, compared with an adjustment without it: the squared length of the twist by
/// which the flange would have to be moved, in standard deviations; 6 is usual.
pub(super) fn outlier_statistic<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    station: &Station<A::From>,
    camera_from_board: &Rigid<A::From, Board>,
) -> f64 {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let needed = needed_flange(adjusted, camera_from_board);
    let deviation = (station.base_from_flange.inverse() * needed).isometry().to_owned();
    let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &deviation);
    let found = chain.gram(camera, &station.observation).and_then(|gram| {
        let inverse = gram.flange().cholesky()?.inverse();
        let through = inverse * gram.cross().transpose();
        let noise = &adjusted.noise;
        let [turn, shift] = [noise.turn_rad.max(ARM_TURN_RAD).powi(2), noise.shift_mm.max(ARM_SHIFT_MM).powi(2)];
        let robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
        let spread = inverse * noise.corner.powi(2) + robot + through * adjusted.covariance * through.transpose();
        let twist = log(&deviation);
        Some(twist.dot(&(spread.cholesky()?.inverse() * twist)))
    });
    found.unwrap_or(f64::INFINITY)
}

/// Returns the pose that the flange must have had for a picture to show the board as it does.
pub(super) fn needed_flange<A: Arrangement>(
    adjusted: &MountAdjustment<A>,
    camera_from_board: &Rigid<A::From, Board>,
) -> Rigid<Base, Flange> {
    let to_from_holder = adjusted.to_from_camera * *camera_from_board * adjusted.holder_from_board.inverse();
    let bare = *to_from_holder.isometry();
    Rigid::from_isometry_unchecked(if A::EYE_IN_HAND { bare.inverse() } else { bare })
}
/// Returns the covariance that a lens of this covariance adds to mount and board; `None` if a corner is behind the
/// camera.
pub(super) fn lens_covariance_effect<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    stations: &[&Station<A::From>],
    lens: &LensCovariance,
) -> Option<MountBoardMatrix> {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let mut pull = SMatrix::<f64, 12, 9>::zeros();
    for station in stations {
        let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &Isometry3::identity());
        let (gram, lens) =
            (chain.gram(camera, &station.observation)?, chain.lens_cross(camera, &station.observation)?);
        let inverse = (gram.flange() + prior_weights(&adjusted.noise)).cholesky()?.inverse();
        pull += lens.fixed_rows::<12>(0) - gram.cross() * inverse * lens.fixed_rows::<6>(12);
    }
    let moved = adjusted.covariance * pull * adjusted.noise.corner.powi(-2);
    Some(moved * lens * moved.transpose())
}

/// Returns the inverse of a covariance or an information matrix of mount and board.
pub(super) fn inverse(normal: &MountBoardMatrix) -> Option<MountBoardMatrix> {
    scaled_inverse(normal)
}
