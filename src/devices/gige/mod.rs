//! GigE Vision cameras, through Aravis.
//!
//! ```text
//! GigeCamera ── ask ──▶ link (a thread) ── owns ──▶ camera: Aravis's objects ── GVCP, GVSP ──▶ a camera,
//!                                                                                     or `loopback` in this process
//! ```
//!
//! What decides is pure and has no Aravis in it: `settings` (what a camera is set to), `acceptance` (which frames are taken),
//! `still` (how often one is tried), `bayer` (one colour a pixel to three). A picture that is handed on is whole, of the
//! calibrated size, newer than the one before, and shows the exposure that was asked for; any doubt is an error.
//!
//! Without the cargo feature `gige` only the pure part is there. Nothing of it has run on a real camera. Each call to a
//! camera meets Aravis in the tests, whose camera has the features of a LUCID Triton by `test_camera.xml`; what it cannot
//! show: whether a Triton means the same by them, a packet that was sent again, a clock that PTP sets, a flange cable.

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
mod sockets;
mod statistics;
mod still;
#[cfg(feature = "gige")]
mod streaming;
mod subnet;

pub use acceptance::{Acceptance, Delivery, Expected, Facts, Gaps, Refused, ahead};
pub use bayer::{demosaic, mosaic};
#[cfg(feature = "gige")]
pub use camera::Frame;
pub use error::GigeError;
pub use format::PixelFormat;
#[cfg(feature = "gige")]
pub use link::{Gauge, GigeCamera, LinkStatus};
#[cfg(feature = "gige")]
pub use loopback::{ADDRESS, Fill, LoopbackCamera, NoLoopback, Register};
pub use search::{FoundCamera, search};
pub use settings::{Exposing, NoNode, PACKET_BYTES, PlanError, Settings, Step, Which, plan};
pub use sockets::{burst_bytes, rmem_max, socket_buffer_bytes};
pub use statistics::Statistics;
pub use still::{NoStill, Shutter, TRIES, take};
pub use subnet::{Subnet, out_of_reach, subnets};

#[cfg(all(test, feature = "gige"))]
pub(super) mod tests;
