//! The faults of a calibration: it is missing, contradicts another one, or lacks the data for its measurement.

use panelprep_service::requirements::CALIBRATION_ADVICE;
use std::path::PathBuf;

/// The reason why a calibration cannot be used or made.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationFault {
    /// The cell's file names no such calibration.
    #[error("{}: [calibration] {key} is missing, and this command needs it: set the key to the path of the calibration file", cell.display())]
    NotCalibrated {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
    },
    /// A mount that was measured with another correction of the arm than the cell's, or with none.
    #[error(
        "{}: was measured with {}, but the cell's file names {}: robot poses would be corrected twice or not at all. \
         Repeat this calibration, or name in [calibration] robot_correction the correction with which it was measured",
        file.display(), describe_correction(found.as_deref()), describe_correction(ours.as_deref())
    )]
    OtherCorrection {
        /// The mount's file.
        file: PathBuf,
        /// The correction's hash in the mount's file.
        found: Option<String>,
        /// The hash of the cell's correction.
        ours: Option<String>,
    },
    /// The correction's file has changed since it was read.
    #[error(
        "{}: the file of [calibration] robot_correction has changed since this program read it; restart the program", cell.display()
    )]
    CorrectionChanged {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The cell's file names a calibration that does not exist.
    #[error(
        "{}: [calibration] {key} names {}, which is not there; {}", cell.display(), file.display(), CALIBRATION_ADVICE
    )]
    CalibrationAway {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
        /// The calibration's file.
        file: PathBuf,
    },
    /// The tool's TCP was measured, but not its axis.
    #[error(
        "{file}: the tool's axis was not measured (axis_measured is not true); a tilted pad grinds an edge into the panel: \
         run `panelprep calibrate tcp` with [[axis]], or with [[plate]] and [[flat]]"
    )]
    NoAxis {
        /// The tool's file.
        file: String,
    },
    /// The controller's axis angles are not numbers.
    #[error("the controller reports axis angles that are not numbers: the flange's pose is not known")]
    NoAxes,
    /// A tool or touch calibration without poses.
    #[error(
        "no poses are given: name the file of the poses, or read the poses from the controller with --live DIR"
    )]
    NoPoses,
    /// A live calibration that names no camera.
    #[error("--live takes pictures: name the camera, --camera scanner or --camera flange-camera")]
    NoLiveCamera,
    /// A board of a kind that is not simulated.
    #[error("the simulated cell has only chessboards: use --board COLUMNSxROWS with --square-mm")]
    NoSimulatedBoard,
    /// A force calibration, but the tool is a spring and has no force.
    #[error("the cell's [tool] is a spring, which has no force to verify")]
    NoCompliantTool,
    /// A readings file without a reading.
    #[error("the file has no [[readings]]")]
    NoReadings,
}

fn describe_correction(hash: Option<&str>) -> String {
    match hash {
        None => "no correction of the arm".to_owned(),
        Some(hash) => format!("the correction of the arm {}", hash.get(..12).unwrap_or(hash)),
    }
}
