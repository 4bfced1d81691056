//! GigE Vision cameras, through Aravis.
//!
//! ```text
//! GigeCamera ── ask ──▶ link (a thread) ── owns ──▶ camera: Aravis's objects ── GVCP, GVSP ──▶ a camera,
//!                                                                                     or `loopback` in this process
//! ```
//!
//! The decisions are in pure code that does not use Aravis: `settings` (the settings of a camera), `acceptance` (which
//! frames are accepted), `single_picture` (the attempts for one picture), `format` (the conversion from a Bayer pattern
//! to RGB). A picture that reaches the caller is complete, has the calibrated size, is newer than the previous picture,
//! and has the requested exposure; in any doubt an error is returned.
//!
//! Without the cargo feature `gige` only the pure code is compiled. The driver has not been tested with a real camera.
//! The tests execute each call with Aravis's fake camera, which has the features of a LUCID Triton as defined in
//! `test_camera.xml`. They do not cover how a real Triton interprets these features, resent packets, a clock that PTP
//! sets, or a cable along the arm.

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
pub use single_picture::{MAX_ATTEMPTS, SinglePictureError, Statistics, TriggeredCamera, capture};

#[cfg(all(test, feature = "gige"))]
pub(super) mod tests;
