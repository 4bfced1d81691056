//! Calibrations with their evidence: intrinsics, camera mounts, tool and arm.
//!
//! The methods are those of the thesis (3.6 and 3.7). The evidence of each result consists of its residuals, its
//! uncertainty at a point of the panel, and the outliers with their reason. The functions compute data from data; they
//! read no pictures and write no files.
//!
//! - `board`, `detect`: the board, and its corners in a picture · `chessboard`, `crossings` · `charuco` · `circles`,
//!   `circle_lattice`: each kind of board · `placing`, `saddle`, `print`: corners to sub-pixel
//! - `intrinsics`: the lens (thesis 3.6), how many coefficients it has, and whether the board is flat · `lens_fit`: its
//!   fit and covariance · `lens_support`: in which part of the picture it is known, and the best next picture
//! - `chain`: camera, flange and board, and the board's pose from one picture
//! - `three_points`: the thesis's own hand-eye calibration (3.7)
//! - `hand_eye`, `adjust`, `station_diagnosis`: the same from many poses; `quantile`: the 95 % radius of its error;
//!   `mounted`: what each kind of mount takes from cell and 3D camera; `variation`: poses around a first one;
//!   `square`: the size of the board's squares, from the robot's motions; `readings`: the intended meaning of poses
//!   that fit no mount
//! - `robot`, `robot_settle`, `arm_errors`: the arm's own errors and its uncertainty; `robot_next`: the best next pose
//!   · `tool`, `force`: tool point, axis and payload · `health`: whether a calibration is still valid · `budget`: the
//!   error at the tool
//! - `scanner_errors`: the deviations of a 3D camera's scans of a flat board from a plane
//! - `board_orientation`: the rotation in which a symmetric board was detected
//! - `gate`: the acceptance checks of calibrations

mod adjust;
pub mod arm_errors;
mod board;
pub mod board_orientation;
pub mod budget;
mod chain;
mod charuco;
mod chessboard;
mod circle_lattice;
mod circles;
mod crossings;
pub mod detect;
mod error;
pub mod force;
mod foreign;
pub mod gate;
pub mod hand_eye;
pub mod health;
pub mod intrinsics;
mod lens_fit;
mod lens_support;
pub mod mounted;
mod placing;
mod print;
mod quantile;
pub mod readings;
pub mod robot;
pub mod robot_next;
mod robot_settle;
mod saddle;
pub mod scanner_errors;
mod square;
mod station_diagnosis;
pub mod three_points;
pub mod tool;
pub mod variation;

#[cfg(test)]
mod tests;

pub use adjust::{MountAdjustment, Noise};
pub use board::{Board, Charuco};
pub use chain::{Arrangement, BoardObservation, BoardPose, Station, board_pose};
pub use charuco::marker_cells;
pub use error::{CalibError, PoseInterpretation, PoseReading};
pub use hand_eye::{HandEye, Residual, Suggestion, suggest_next_pose};
pub use square::SquareSize;
pub use station_diagnosis::{StationFault, SuspectStation};
