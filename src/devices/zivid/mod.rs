//! The Zivid 3D camera, through its vendor's SDK, which runs in a process of its own.
//!
//! ```text
//! the daemon                                        the worker: the same program in another role
//! scanner ── host ── link ══ Unix socket, frames ══ worker ── library ── libpanelprep_zivid.so ── Zivid SDK
//! ```
//! The SDK is C++ on a graphics processor; its failures must not affect the process that holds the robot's link. The
//! daemon loads no part of the SDK: one program serves cells with and without it.
//!
//! - [`wire`]: frames that are complete and unchanged, or refused · [`message`]: their messages
//! - [`budget`]: the limit of the worker's restarts · [`accept`]: whether the received data is what was requested ·
//!   [`fault`]: the faults and their messages
//! - [`warmth`]: whether the camera has reached its stable temperature
//! - [`host`], [`process`]: the daemon's side, with its end of the link · [`ZividScanner`]: the camera as the cell has
//!   it
//! - [`worker`], [`sensor`], [`library`]: the worker's side · `cpp/`: the C interface over the SDK,
//!   declarations to build it without the SDK, and a camera simulated by them
//!
//! A shot of 1944×1200 points is 44 MB. It is sent through the socket by plain large writes, which make two copies
//! that overlap in time. Sealed memory passed by its file descriptor was measured for comparison: it takes three times
//! as long if it is not mapped, and mapping is `unsafe`.

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
