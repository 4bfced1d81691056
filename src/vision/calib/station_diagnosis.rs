//! Determines the probable error of an outlier station; it corrects nothing.
//!
//! A picture implies a pose of the flange. The difference between this pose and the pose in the file identifies the
//! error: a board that was detected upside down, two exchanged pictures, a mistyped number, or a pose that is
//! completely wrong.

use super::adjust;
use super::adjust::MountAdjustment;
use super::board::Board;
use super::chain::{Arrangement, BoardObservation, BoardPose, Station, board_pose};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Degrees, Flange, KukaPose, PinholeCamera, Point, Rigid, median};
use std::fmt::Write;

/// Maximum angle between the line of sight and the normal of the board, degrees; at a larger angle the corners are
/// located poorly.
const MAX_VIEW_ANGLE_DEG: f64 = 65.0;
/// Maximum residual of the corners of a good picture, as a multiple of the usual residual.
const MAX_RMS_MULTIPLE: f64 = 3.0;
/// Lower limit of the usual residual in this comparison, px or mm: smaller residuals are good, independently of the
/// other pictures.
const MIN_USUAL_RMS: f64 = 0.05;
/// Minimum error of a pose with a mistyped number: `MIN_TYPO_MM` in mm or `MIN_TYPO_DEG` in degrees.
const MIN_TYPO_MM: f64 = 1.0;
const MIN_TYPO_DEG: f64 = 0.2;

/// The probable cause of the deviation of a station.
#[derive(Debug, Clone, PartialEq)]
pub enum StationFault {
    /// The board was detected upside down.
    Flipped,
    /// The poses of this picture and another one are exchanged.
    Swapped {
        /// Name of the other picture.
        other_picture: String,
    },
    /// The picture shows the board as the pose of another picture predicts it: it is a copy, or a picture is missing.
    ShowsPoseOf {
        /// Name of the other picture.
        other_picture: String,
    },
    /// One number of the pose is mistyped.
    Mistyped {
        /// Key of the number in the pose.
        key: &'static str,
        /// The stated value in the file.
        stated_value: f64,
        /// The value that the picture shows.
        observed_value: f64,
    },
    /// Two angles or lengths are exchanged.
    Exchanged {
        /// Key of the first number.
        key: &'static str,
        /// Key of the second number.
        other: &'static str,
    },
    /// The picture is doubtful: the board is seen at a grazing angle.
    Grazing {
        /// Angle between the normal of the board and the line of sight, degrees.
        tilt_deg: f64,
    },
    /// The picture is doubtful: its corners have larger residuals than those of other pictures.
    Rough {
        /// Root mean square residual of the corners, px or mm.
        rms: f64,
        /// Median of this residual in the other pictures.
        median: f64,
    },
    /// The deviation is too small for a mistyped number.
    TooSmall,
    /// No known cause explains the deviation.
    Unknown {
        /// The flange pose according to the picture.
        expected_pose: KukaPose,
    },
}

/// A station whose deviation is larger than its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct SuspectStation {
    /// Name of the picture.
    pub name: String,
    /// Distance between the positions of the board's centre according to picture and robot, mm.
    pub distance_mm: f64,
    /// The probable cause of the deviation.
    pub fault: StationFault,
}

impl std::fmt::Display for SuspectStation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} is {:.2} mm off: ", self.name, self.distance_mm)?;
        match &self.fault {
            StationFault::Flipped => write!(
                f,
                "the board in this picture was detected upside down (it fits if it is rotated by 180°); use a board \
                 with one odd and one even side, or omit the picture"
            ),
            StationFault::Swapped { other_picture: with } => {
                write!(f, "this picture and {with} each fit the pose of the other; exchange their poses")
            }
            StationFault::ShowsPoseOf { other_picture: other } => {
                write!(f, "this picture matches the pose of {other}; name the right picture, or omit it")
            }
            StationFault::Mistyped { key, stated_value: written, observed_value: seen } => {
                write!(
                    f,
                    "its {key} is stated as {written}, but according to the picture it is {seen:.3}; correct the \
                     value"
                )
            }
            StationFault::Exchanged { key, other } => {
                write!(f, "its {key} and {other} are exchanged; correct them")
            }
            StationFault::Grazing { tilt_deg } => write!(
                f,
                "the board is seen at {tilt_deg:.0}° from its normal, an angle at which corners are inaccurate; \
                 omit the picture"
            ),
            StationFault::Rough { rms, median: usual } => write!(
                f,
                "the residual of its corners is {rms:.3} rms, that of the other pictures is {usual:.3}; omit the \
                 picture"
            ),
            StationFault::TooSmall => write!(
                f,
                "this deviation is larger than the scatter of the other pictures, but too small for a wrong \
                 number; omit the picture, or take it again"
            ),
            StationFault::Unknown { expected_pose: needed } => {
                let mut pose = String::new();
                #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
                let _ = write!(pose, "{needed}");
                write!(
                    f,
                    "according to the picture, the flange was at {pose}; correct the pose, or omit the picture"
                )
            }
        }
    }
}

pub(super) fn name<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    adjusted: &MountAdjustment<A>,
    stations: &[Station<A::From>],
    poses: &[BoardPose<A::From>],
    used: &[bool],
    limit: f64,
) -> Vec<SuspectStation> {
    let trial = StationTrial { camera, board, adjustment: adjusted, stations, poses, limit };
    let wrong: Vec<usize> = (0..stations.len()).filter(|&index| !used[index]).collect();
    wrong
        .iter()
        .map(|&index| SuspectStation {
            name: stations[index].name.clone(),
            distance_mm: trial.distance_mm(index),
            fault: trial.diagnose(index, &wrong),
        })
        .collect()
}

struct StationTrial<'a, A: Arrangement> {
    camera: &'a PinholeCamera,
    board: &'a Board,
    adjustment: &'a MountAdjustment<A>,
    stations: &'a [Station<A::From>],
    poses: &'a [BoardPose<A::From>],
    limit: f64,
}

impl<A: Arrangement> StationTrial<'_, A> {
    fn distance_mm(&self, index: usize) -> f64 {
        let moved = A::to_from_holder(&self.stations[index].base_from_flange);
        let said = self.adjustment.to_from_camera.inverse() * moved * self.adjustment.holder_from_board;
        said.distance_at_mm(self.poses[index].camera_from_board, self.board.centre())
    }

    /// Returns whether the picture agrees with this flange pose.
    fn is_consistent(&self, index: usize, base_from_flange: Rigid<Base, Flange>) -> bool {
        let station = Station { base_from_flange, ..self.stations[index].clone() };
        self.is_consistent_with_pose(&station, &self.poses[index])
    }

    fn is_consistent_with_pose(&self, station: &Station<A::From>, pose: &BoardPose<A::From>) -> bool {
        adjust::outlier_statistic(self.camera, self.adjustment, station, &pose.camera_from_board) <= self.limit
    }

    fn diagnose(&self, index: usize, wrong: &[usize]) -> StationFault {
        if self.is_flipped(index) {
            return StationFault::Flipped;
        }
        let at_pose_of = |other: usize| self.is_consistent(index, self.stations[other].base_from_flange);
        let mut others = (0..self.stations.len()).filter(|&other| other != index);
        let Some(other) = others.find(|&other| at_pose_of(other)) else {
            return self.poor_picture(index).unwrap_or_else(|| self.diagnose_mistyped(index));
        };
        let name = self.stations[other].name.clone();
        let back = wrong.contains(&other) && self.is_consistent(other, self.stations[index].base_from_flange);
        if back {
            StationFault::Swapped { other_picture: name }
        } else {
            StationFault::ShowsPoseOf { other_picture: name }
        }
    }

    fn is_flipped(&self, index: usize) -> bool {
        let (right, low) = (self.board.columns() as f64 - 1.0, self.board.rows() as f64 - 1.0);
        let far = [right * self.board.square_mm(), low * self.board.square_mm()];
        let turned = |q: &Point<_>| Point::at(far[0] - q.mm.x, far[1] - q.mm.y, 0.0);
        let station = &self.stations[index];
        let seen = match &station.observation {
            BoardObservation::Pixels(corners) => {
                BoardObservation::Pixels(corners.iter().map(|(q, pixel)| (turned(q), *pixel)).collect())
            }
            BoardObservation::Points(corners) => {
                BoardObservation::Points(corners.iter().map(|(q, point)| (turned(q), *point)).collect())
            }
        };
        let station = Station { observation: seen, ..station.clone() };
        board_pose(self.camera, &station.observation)
            .is_ok_and(|pose| self.is_consistent_with_pose(&station, &pose))
    }

    /// Returns the cause if the picture is more doubtful than the pose.
    fn poor_picture(&self, index: usize) -> Option<StationFault> {
        let pose = &self.poses[index];
        let (place, normal) = (
            (pose.camera_from_board * self.board.centre()).mm.coords,
            pose.camera_from_board.rotation() * Vector3::z(),
        );
        let tilt_deg = Degrees::from_rad(place.normalize().dot(&normal).abs().min(1.0).acos()).0;
        if tilt_deg > MAX_VIEW_ANGLE_DEG {
            return Some(StationFault::Grazing { tilt_deg });
        }
        let mut others: Vec<f64> =
            self.poses.iter().enumerate().filter(|(other, _)| *other != index).map(|(_, pose)| pose.rms).collect();
        let usual = median(&mut others)?;
        (pose.rms > MAX_RMS_MULTIPLE * usual.max(MIN_USUAL_RMS))
            .then_some(StationFault::Rough { rms: pose.rms, median: usual })
    }

    fn diagnose_mistyped(&self, index: usize) -> StationFault {
        let off = self.stations[index].base_from_flange.inverse()
            * adjust::needed_flange(self.adjustment, &self.poses[index].camera_from_board);
        if off.origin().mm.coords.norm() < MIN_TYPO_MM && off.rotation_angle().0 < MIN_TYPO_DEG {
            return StationFault::TooSmall;
        }
        let written = KukaPose::from_rigid(&self.stations[index].base_from_flange);
        let needed =
            KukaPose::from_rigid(&adjust::needed_flange(self.adjustment, &self.poses[index].camera_from_board));
        let fits = |pose: KukaPose| self.is_consistent(index, pose.to_rigid());
        for (key, field) in KEYS {
            let mut pose = written;
            *field(&mut pose) = *field(&mut needed.clone());
            if fits(pose) {
                let (written, seen) = (*field(&mut written.clone()), *field(&mut needed.clone()));
                return StationFault::Mistyped { key, stated_value: written, observed_value: seen };
            }
        }
        for (first, (key, field)) in KEYS.iter().enumerate() {
            for (other, other_field) in &KEYS[first + 1..] {
                let mut pose = written;
                (*field(&mut pose), *other_field(&mut pose)) =
                    (*other_field(&mut written.clone()), *field(&mut written.clone()));
                if fits(pose) {
                    return StationFault::Exchanged { key, other };
                }
            }
        }
        StationFault::Unknown { expected_pose: needed }
    }
}

type Field = fn(&mut KukaPose) -> &mut f64;

const KEYS: [(&str, Field); 6] = [
    ("x_mm", |pose| &mut pose.x_mm),
    ("y_mm", |pose| &mut pose.y_mm),
    ("z_mm", |pose| &mut pose.z_mm),
    ("a_deg", |pose| &mut pose.a_deg),
    ("b_deg", |pose| &mut pose.b_deg),
    ("c_deg", |pose| &mut pose.c_deg),
];
