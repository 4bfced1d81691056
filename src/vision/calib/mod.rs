//! Calibration that proves itself: intrinsics, camera mounts, tool, and how good each of them is.
//!
//! Thesis 3.6 and 3.7, and for each result its evidence: residuals, uncertainty at a point of the panel, what does
//! not fit and why. Data in, data out; pictures are read and files written elsewhere.
//!
//! - `board`, `detect`: the board, and its corners in a picture · `chessboard`, `crossings`, `lattice` · `charuco`,
//!   `charuco_grow`, `charuco_lattice` · `circles`, `circle_lattice`, `circle_places`, `blobs`: each kind of board
//!   · `placing`, `saddle`, `print`, `surface`: corners to sub-pixel
//! - `intrinsics`: the lens (thesis 3.6), with `lens_gram`, `lens_fit`; how many coefficients it has: `lens_model`,
//!   `lens_choice`; how well and in which part of the picture it is known: `lens_covariance`, `lens_support`; what
//!   to do next: `lens_next`; is the board flat: `board_shape`
//! - `pose`: the board's pose from one picture
//! - `three_points`: the thesis's own hand-eye calibration (3.7)
//! - `hand_eye`, `consensus`, `chain`, `adjust`, `influence`, `station_diagnosis`, `suggest`: the same from many poses;
//!   `alike`: how many poses count as one; `square`: the size of the board's squares by them; `readings`,
//!   `pose_diagnosis`: the intended meaning of poses that fit no mount
//! - `robot`, `robot_data`, `robot_settle`, `robot_found`, `arm_errors`, `robot_correction`, `robot_axes`: the
//!   arm's own errors; how far off it may be: `robot_spread`; what to do next: `robot_next` · `tool`: tool point
//!   and axis · `health`: is a calibration still true · `budget`: the error at the tool
//! - `scanner_errors`: the deviations of a 3D camera's scans of a flat board from a plane
//! - `turned`: in which rotation a symmetric board was detected
//! - `gate`: turns evidence into a verdict

mod adjust;
mod alike;
pub mod arm_errors;
mod arrangement;
mod blobs;
mod board;
pub mod board_orientation;
mod board_shape;
pub mod budget;
mod chain;
mod charuco;
mod charuco_grow;
mod charuco_lattice;
mod chessboard;
mod circle_lattice;
mod circle_places;
mod circles;
mod consensus;
mod crossings;
pub mod detect;
mod error;
pub mod force;
mod foreign;
pub mod gate;
pub mod hand_eye;
pub mod health;
mod influence;
pub mod intrinsics;
mod lattice;
mod lens_choice;
mod lens_covariance;
mod lens_fit;
mod lens_gram;
mod lens_model;
mod lens_next;
mod lens_support;
mod placing;
mod pose;
mod pose_diagnosis;
mod print;
mod quantile;
pub mod readings;
pub mod robot;
mod robot_axes;
mod robot_correction;
mod robot_data;
mod robot_found;
pub mod robot_next;
mod robot_settle;
mod robot_spread;
mod saddle;
pub mod scanner_errors;
mod square;
mod station_diagnosis;
mod suggest;
mod surface;
pub mod three_points;
pub mod tool;

#[cfg(test)]
mod tests;

pub use adjust::{MountAdjustment, Noise};
pub use arrangement::Arrangement;
pub use board::{Board, Charuco};
pub use chain::{BoardObservation, Station};
pub use charuco::marker_cells;
pub use error::CalibError;
pub use hand_eye::{HandEye, Residual};
pub use pose::{BoardPose, board_pose};
pub use pose_diagnosis::{PoseInterpretation, PoseReading};
pub use quantile::{student_95, student_quantile};
pub use square::SquareSize;
pub use station_diagnosis::{StationFault, SuspectStation};
pub use suggest::{Suggestion, suggest_next_pose};
