//! The cell's two cameras: what a shot is, and who delivers it.
//!
//! [`PictureQuality`] and [`ScanQuality`] say how good a shot is. A capture blocks until the shot is there or an error says why not. Shots carry when they were taken, on the clock
//! of whoever took them; a picture of a played or simulated flange camera carries where the flange was.
//!
//! - [`SimulatedScanner`], [`SimulatedFlangeCamera`]: the renderer, looking at the simulated world
//! - [`SimulatedBoards`]: the same cameras before a calibration board
//! - [`RecordedScanner`], [`RecordedFlangeCamera`]: a folder, one file a capture
//! - [`GigeFlangeCamera`]: a GigE Vision camera on the flange · [`LoopbackFlangeCamera`], [`BayerFlangeCamera`]: the
//!   simulated one behind a colour sensor's filters, with and without a network between

mod bayer;
mod boards;
mod capture;
mod error;
#[cfg(feature = "gige")]
mod gige;
mod quality;
mod recorded;
mod simulated;

pub use bayer::BayerFlangeCamera;
pub use boards::{BoardView, SimulatedBoards};
pub use capture::{Conditions, FlangeCamera, FlangePicture, Picture, Scanner, Shot};
pub use error::{CameraError, FileError, Which};
#[cfg(feature = "gige")]
pub use gige::{GigeFlangeCamera, LoopbackFlangeCamera};
pub use quality::{PictureQuality, ScanQuality};
pub use recorded::{RecordedFlangeCamera, RecordedScanner};
pub use simulated::{Arm, SimulatedFlangeCamera, SimulatedScanner, simulated};

#[cfg(test)]
pub mod conform;
#[cfg(test)]
mod tests;
