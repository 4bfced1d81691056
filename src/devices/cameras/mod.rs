//! The cell's two cameras: the content of a shot, and the sources that deliver it.
//!
//! [`PictureQuality`] and [`ScanQuality`] state the quality of a shot. A capture blocks until the shot is available or
//! an error states why not. Shots carry the time at which they were taken, on the clock of their source; a picture of
//! a recorded or simulated flange camera carries the pose of the flange.
//!
//! - [`SimulatedScanner`], [`SimulatedFlangeCamera`]: the renderer, viewing the simulated world
//! - [`SimulatedBoards`]: the same cameras in front of a calibration board
//! - [`RecordedScanner`], [`RecordedFlangeCamera`]: the files of a folder, one for each capture
//! - [`GigeFlangeCamera`]: a GigE Vision camera on the flange · [`LoopbackFlangeCamera`], [`BayerFlangeCamera`]: the
//!   simulated camera behind a colour sensor's filters, with and without a network between

mod capture;
#[cfg(feature = "gige")]
mod gige;
mod recorded;
mod simulated;

pub use capture::{
    CameraError, CameraRole, Conditions, FileError, FlangeCamera, FlangePicture, Picture, Scanner, Shot,
};
pub use capture::{PictureQuality, ScanQuality};
#[cfg(feature = "gige")]
pub use gige::{GigeFlangeCamera, LoopbackFlangeCamera};
pub use recorded::{RecordedFlangeCamera, RecordedScanner};
pub use simulated::{
    Arm, BayerFlangeCamera, BoardView, SimulatedBoards, SimulatedFlangeCamera, SimulatedScanner, simulated_cameras,
};

#[cfg(test)]
pub mod conform;
