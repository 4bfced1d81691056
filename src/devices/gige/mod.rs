//! GigE Vision cameras, through Aravis.
//!
//! ```text
//! GigeCamera ── ask ──▶ link (a thread) ── owns ──▶ camera: Aravis's objects ── GVCP, GVSP ──▶ a camera,
//!                                                                                     or `loopback` in this process
//! ```
//!
//! The code that decides is pure and does not use Aravis: `settings` (the settings of a camera), `acceptance` (which
//! frames are accepted), `single_picture` (how often a picture is tried), `bayer` (from one colour per pixel to
//! three). A picture that is passed on is complete, has the calibrated size, is newer than the previous one, and has
//! the requested exposure; any doubt is an error.
//!
//! Without the cargo feature `gige` only the pure part is compiled. No part has run on a real camera. The tests
//! execute each call to a camera with Aravis's simulated camera, which has the features of a LUCID Triton as described
//! in `test_camera.xml`. They do not cover how a real Triton interprets these features, packets that are sent again, a
//! clock that PTP sets, or a flange cable.

mod acceptance;
mod bayer;
#[cfg(feature = "gige")]
mod camera;
#[cfg(feature = "gige")]
mod configure;
mod error;
mod format;
#[cfg(feature = "gige")]
mod link;
#[cfg(feature = "gige")]
mod loopback;
mod search;
mod settings;
mod single_picture;
mod sockets;
mod statistics;
#[cfg(feature = "gige")]
mod streaming;
mod subnet;

pub use acceptance::{
    Acceptance, Delivery, FrameMetadata, FrameRefusal, FrameRequirements, GapPolicy, frames_ahead,
};
pub use bayer::{demosaic, mosaic};
#[cfg(feature = "gige")]
pub use camera::Frame;
pub use error::GigeError;
pub use format::PixelFormat;
#[cfg(feature = "gige")]
pub use link::{GigeCamera, LinkMonitor, LinkStatus};
#[cfg(feature = "gige")]
pub use loopback::{FillPixels, LOOPBACK_ADDRESS, LoopbackCamera, LoopbackError, Register};
pub use search::{FoundCamera, search};
pub use settings::{
    CameraSelector, ExposureMode, MissingNode, PACKET_BYTES, PlanError, SettingStep, Settings, plan,
};
pub use single_picture::{MAX_ATTEMPTS, StillError, TriggeredCamera, capture};
pub use sockets::{burst_bytes, rmem_max, socket_buffer_bytes};
pub use statistics::Statistics;
pub use subnet::{Subnet, parse_subnets, unreachable_reason};

#[cfg(all(test, feature = "gige"))]
pub(super) mod tests;
