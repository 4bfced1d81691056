//! The two cameras of the cell: the data of a picture or scan, and the sources that deliver them.
//!
//! [`PictureQuality`] and [`ScanQuality`] are quality measures. A capture blocks until the picture is available, or
//! returns an error with the reason. Each picture contains the time of its exposure on the clock of its source; a
//! picture of a recorded or simulated flange camera also contains the pose of the flange.
//!
//! - [`SimulatedScanner`], [`SimulatedFlangeCamera`]: render the simulated world
//! - [`SimulatedBoards`]: the same cameras in front of a calibration board
//! - [`RecordedScanner`], [`RecordedFlangeCamera`]: replay the files of a folder, one for each capture
//! - [`GigeFlangeCamera`]: a GigE Vision camera on the flange · [`LoopbackFlangeCamera`], [`BayerFlangeCamera`]: the
//!   simulated camera with a colour sensor's filters; the first sends its pictures over a network, the second does not

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
