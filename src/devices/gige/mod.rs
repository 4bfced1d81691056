//! GigE Vision cameras, through Aravis.
//!
//! ```text
//! GigeCamera ── ask ──▶ link (a thread) ── owns ──▶ camera: Aravis's objects ── GVCP, GVSP ──▶ a camera,
//!                                                                                     or `loopback` in this process
//! ```
//!
//! The code that decides is pure and does not use Aravis: `settings` (the settings of a camera), `acceptance` (which
//! frames are accepted), `single_picture` (the attempts for a picture), `format` (from one colour per pixel to
//! three). A picture that is passed on is complete, has the calibrated size, is newer than the previous one, and has
//! the requested exposure; any doubt is an error.
//!
//! Without the cargo feature `gige` only the pure part is compiled. No part has run on a real camera. The tests
//! execute each call to a camera with Aravis's simulated camera, which has the features of a LUCID Triton as described
//! in `test_camera.xml`. They do not cover how a real Triton interprets these features, packets that are sent again, a
//! clock that PTP sets, or a flange cable.

mod acceptance;
#[cfg(feature = "gige")]
mod camera;
mod error;
mod format;
#[cfg(feature = "gige")]
mod link;
#[cfg(feature = "gige")]
mod loopback;
mod network;
mod settings;
mod single_picture;
#[cfg(feature = "gige")]
mod streaming;

pub use acceptance::{
    Acceptance, Delivery, FrameMetadata, FrameRefusal, FrameRequirements, GapPolicy, frames_ahead,
};
#[cfg(feature = "gige")]
pub use camera::Frame;
pub use error::GigeError;
pub use format::PixelFormat;
pub use format::{demosaic, mosaic};
#[cfg(feature = "gige")]
pub use link::{GigeCamera, LinkMonitor, LinkStatus};
#[cfg(feature = "gige")]
pub use loopback::{FillPixels, LOOPBACK_ADDRESS, LoopbackCamera, LoopbackError, Register};
pub use network::{
    FoundCamera, Subnet, burst_bytes, parse_subnets, rmem_max, search, socket_buffer_bytes, unreachable_reason,
};
pub use settings::{
    CameraSelector, ExposureMode, MissingNode, PACKET_BYTES, PlanError, SettingStep, Settings, plan,
};
pub use single_picture::{MAX_ATTEMPTS, Statistics, StillError, TriggeredCamera, capture};

#[cfg(all(test, feature = "gige"))]
pub(super) mod tests;
