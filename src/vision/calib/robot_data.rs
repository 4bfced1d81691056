//! The data for the calibration of an arm: rigs of camera and board, pictures, and touches.

use super::adjust::scaled_inverse;
use super::arrangement::Twist;
use super::chain::BoardObservation;
use super::detect::Corners;
use super::error::CalibError;
use super::lens_gram::LensGram;
use super::pose::board_pose;
use super::robot_correction::ArmPose;
use nalgebra::{Isometry3, Matrix6};
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Point, Rigid};
use panelprep_cell::cell::ArmGeometry;

/// Which of camera and board moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigKind {
    /// The camera is fixed, the board is on the flange.
    EyeToHand,
    /// The camera is on the flange, the board is fixed.
    EyeInHand,
}

/// A camera with the board that it sees, and the approximate poses of both.
#[derive(Debug, Clone)]
pub struct Rig {
    /// Whether the camera or the board moves.
    pub kind: RigKind,
    /// The camera's mount: on the base, or on the flange.
    pub mount: Isometry3<f64>,
    /// The board's mount: on the flange, or on the base.
    pub board: Isometry3<f64>,
}

/// A picture.
#[derive(Debug, Clone)]
pub struct ArmView {
    /// The picture's name in messages.
    pub name: String,
    /// The rig that made the picture.
    pub rig: usize,
    /// The robot's pose.
    pub pose: ArmPose,
    /// The board's pose in the picture.
    pub camera_from_board: Isometry3<f64>,
    /// The information of that pose: the inverse of its covariance, in rad and mm.
    pub information: Matrix6<f64>,
    /// The residual of its corners, rms, px.
    pub rms_px: f64,
}

/// The robot's repeatability, mm; `REPEAT_RAD` is that of the rotation, rad.
pub(super) const REPEAT_MM: f64 = 0.03;
const REPEAT_RAD: f64 = 5e-5;
/// The least assumed error of a corner, px.
const MIN_PX: f64 = 0.02;

impl ArmView {
    /// Makes a view from the corners that a picture shows.
    ///
    /// # Errors
    /// If they determine no pose.
    pub fn from_corners(
        name: String,
        rig: usize,
        pose: ArmPose,
        camera: &PinholeCamera,
        corners: &Corners,
    ) -> Result<Self, CalibError> {
        let found = board_pose::<Camera>(camera, &BoardObservation::Pixels(corners.clone()))?;
        let unsettled = CalibError::NotSettled { what: "the board's pose" };
        let information = information(camera, corners, &found.camera_from_board, found.rms).ok_or(unsettled)?;
        let camera_from_board = *found.camera_from_board.isometry();
        Ok(ArmView { name, rig, pose, camera_from_board, information, rms_px: found.rms })
    }
}

/// Returns the information of the board's pose in a picture with this error of its corners.
pub(super) fn information(
    camera: &PinholeCamera,
    corners: &Corners,
    camera_from_board: &Rigid<Camera, Board>,
    rms_px: f64,
) -> Option<Matrix6<f64>> {
    let gram = LensGram::compute(camera, corners, camera_from_board)?;
    let of_corners = scaled_inverse(&gram.pose)? * rms_px.max(MIN_PX).powi(2);
    let far_mm = camera_from_board.origin().mm.coords.norm();
    let (turn, shift) = (REPEAT_RAD.powi(2), REPEAT_MM.powi(2) + (far_mm * REPEAT_RAD).powi(2));
    let of_robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
    scaled_inverse(&(of_corners + of_robot))
}

/// The object that the tip touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TouchTarget {
    /// A fixed spot at an unknown position, by its number; all touches of one spot have the same number.
    Spot(usize),
    /// A corner of the fixed board that the camera on the flange sees.
    Corner {
        /// The rig with that board.
        rig: usize,
        /// The corner.
        place: Point<Board>,
    },
    /// A position that the fixed camera sees.
    Seen {
        /// The rig with that camera.
        rig: usize,
        /// The place.
        place: Point<Camera>,
    },
}

/// A touch of the tool's tip.
#[derive(Debug, Clone)]
pub struct ArmTouch {
    /// The touched target.
    pub target: TouchTarget,
    /// The robot's pose.
    pub pose: ArmPose,
}

/// The measured data: pictures of boards and touches.
#[derive(Debug, Clone)]
pub struct RobotData {
    /// The arm's nominal geometry.
    pub geometry: ArmGeometry,
    /// The rigs.
    pub rigs: Vec<Rig>,
    /// The pictures.
    pub views: Vec<ArmView>,
    /// The touches.
    pub touches: Vec<ArmTouch>,
}
