//! The Zivid 3D camera, through the vendor's SDK, which runs in a separate process.
//!
//! ```text
//! the daemon                                        the worker: the same program in another role
//! scanner ── host ── link ══ Unix socket, frames ══ worker ── library ── libpanelprep_zivid.so ── Zivid SDK
//! ```
//! The SDK is C++ code that uses the GPU; its failures must not affect the process that controls the robot. The daemon
//! loads no part of the SDK, so the same program is used in cells with and without it.
//!
//! - [`wire`]: the frames, which are complete and unchanged or are refused · [`message`]: the messages in them
//! - [`budget`]: the limit of the worker's restarts · [`accept`]: whether the received data are those that were
//!   requested · [`fault`]: the faults and their messages
//! - [`warmth`]: whether the camera has reached its stable temperature
//! - [`host`], [`process`]: the daemon's side, with its end of the socket · [`ZividScanner`]: the camera as the cell's
//!   scanner
//! - [`worker`], [`sensor`], [`library`]: the worker's side · `cpp/`: the C interface to the SDK, a stub to build it
//!   without the SDK, and a camera that the stub simulates
//!
//! A scan of 1944×1200 points has 44 MB. It is sent through the socket with large writes; the two copies that this
//! needs overlap in time. For comparison, sealed memory that is passed by its file descriptor was measured: without
//! mapping it takes three times as long, and mapping is `unsafe`.

pub mod accept;
pub mod budget;
pub mod fault;
pub mod host;
pub mod library;
pub mod message;
pub mod process;
mod scanner;
pub mod sensor;
pub mod warmth;
pub mod wire;
pub mod worker;

#[cfg(test)]
mod tests;

pub use budget::Restarts;
pub use fault::ZividFault;
pub use host::{AnswerTimeouts, CameraSetup};
pub use message::{Flicker, Light, Size, Source};
pub use process::{WorkerLauncher, command_launcher};
pub use scanner::{CameraMonitor, ZividPicture, ZividScanner, ZividShot};
pub use warmth::WarmUpState;
