//! Suggests the next pose for a hand-eye calibration.
//!
//! Every station so far is tilted and rotated about the board's centre, and moved nearer and farther. Of those that keep
//! the whole board in the picture, the best is the one after which the uncertainty at the panel is least, as the
//! information of (2) in `adjust` predicts it.

use super::adjust::covariance_at;
use super::arrangement::Arrangement;
use super::board::Board;
use super::chain::{BoardObservation, Station};
use super::hand_eye::HandEye;
use super::influence;
use super::quantile::radius_95;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Degrees, Flange, KukaPose, PinholeCamera, Rigid};

/// A recommended pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suggestion {
    /// The pose to which the flange is to go.
    pub base_from_flange: KukaPose,
    /// The uncertainty after this pose, mm.
    pub uncertainty_mm: f64,
}

const TILT_DEG: f64 = 25.0;
const NEARER: f64 = 0.8;
/// If the board is tilted by more than this, its corners are detected poorly, degrees.
const MAX_TILT_DEG: f64 = 50.0;

/// Returns the next pose, if one was found that reduces the uncertainty.
pub fn suggest_next_pose<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    stations: &[Station<A::From>],
    found: &HandEye<A>,
) -> Option<Suggestion> {
    let known = influence::inverse(&found.adjustment.covariance)?;
    let used = stations.iter().zip(&found.residuals).filter(|(_, residual)| residual.used);
    let mut best: Option<Suggestion> = None;
    for (station, _) in used {
        for change in changes() {
            let moved = A::to_from_holder(&station.base_from_flange);
            let seen: Rigid<A::From, panelprep_base::geometry::Board> =
                found.adjustment.to_from_camera.inverse() * moved * found.adjustment.holder_from_board;
            let camera_from_board = rotated_pose(&seen, board, &change);
            let base_from_flange = influence::needed_flange(&found.adjustment, &camera_from_board);
            let Some(candidate) = simulate_station::<A>(camera, board, base_from_flange, &camera_from_board) else {
                continue;
            };
            let Some((gain, _)) = influence::information(camera, &found.adjustment, &candidate) else { continue };
            let Some(covariance) = influence::inverse(&(known + gain)) else { continue };
            let spread = covariance_at(&found.adjustment.to_from_camera, &covariance, found.stated_point)
                * found.correlated_pose_count;
            let uncertainty_mm = radius_95(&spread, found.redundancy());
            if best.is_none_or(|best| uncertainty_mm < best.uncertainty_mm) {
                best =
                    Some(Suggestion { base_from_flange: KukaPose::from_rigid(&base_from_flange), uncertainty_mm });
            }
        }
    }
    best.filter(|best| best.uncertainty_mm < found.uncertainty_mm)
}

/// A turn about the board's middle, and a factor on its distance.
struct PoseChange {
    turn: UnitQuaternion<f64>,
    factor: f64,
}

fn changes() -> Vec<PoseChange> {
    let axes = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let turn = |axis: &Vector3<f64>| UnitQuaternion::from_scaled_axis(axis * Degrees(TILT_DEG).to_rad());
    [NEARER, 1.0, 1.0 / NEARER]
        .into_iter()
        .flat_map(|factor| axes.iter().map(move |axis| PoseChange { turn: turn(axis), factor }).collect::<Vec<_>>())
        .collect()
}

fn rotated_pose<C: panelprep_base::geometry::Frame>(
    camera_from_board: &Rigid<C, panelprep_base::geometry::Board>,
    board: &Board,
    change: &PoseChange,
) -> Rigid<C, panelprep_base::geometry::Board> {
    let middle = board.centre().mm.coords;
    let about = Translation3::from(middle) * change.turn * Translation3::from(-middle);
    let place = (*camera_from_board * board.centre()).mm.coords;
    let shift = Translation3::from(place * (change.factor - 1.0));
    let moved: Isometry3<f64> = shift * camera_from_board.isometry() * about;
    Rigid::from_isometry_unchecked(moved)
}

/// Returns the station that a picture would give, or `None` if the board leaves the picture or is tilted too far.
fn simulate_station<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    base_from_flange: Rigid<Base, Flange>,
    camera_from_board: &Rigid<A::From, panelprep_base::geometry::Board>,
) -> Option<Station<A::From>> {
    let facing = (camera_from_board.rotation() * Vector3::z()).z;
    if facing < Degrees(MAX_TILT_DEG).to_rad().cos() {
        return None;
    }
    let corners: Option<Vec<_>> = board
        .corners()
        .into_iter()
        .map(|corner| Some((corner, camera.project_inside(*camera_from_board * corner)?)))
        .collect();
    Some(Station {
        name: "the next pose".to_owned(),
        base_from_flange,
        observation: BoardObservation::Pixels(corners?),
    })
}
