//! The Zivid 3D camera, through its vendor's SDK, which runs in a process of its own.
//!
//! ```text
//! the daemon                                        the worker: the same program in another role
//! scanner ── host ── link ══ Unix socket, frames ══ worker ── library ── libpanelprep_zivid.so ── Zivid SDK
//! ```
//! The SDK is C++ on a graphics processor; what it does to its process it shall not do to the one that holds the
//! robot's link. The daemon loads nothing of it: one program serves cells with and without.
//!
//! - [`wire`], `frame`: frames that are whole and unchanged, or refused · [`message`]: what is said in them
//! - [`budget`]: how often a worker is started again · [`accept`]: is what came what was asked for? · [`fault`]: in words
//! - [`warmth`]: is the camera as warm as it stays?
//! - [`host`], [`link`], [`process`]: the daemon's side · [`ZividScanner`]: the camera as the cell has it
//! - [`worker`], `camera`, `clip`, [`sensor`], [`library`]: the worker's side · `cpp/`: the C interface over the SDK, declarations to build
//!   it without one, and a camera that they play
//!
//! A shot of 1944×1200 points is 44 MB. It goes through the socket by plain large writes: two copies that overlap. Sealed
//! memory that is handed over by its descriptor was measured beside it and takes three times as long without
//! mapping it (which is `unsafe`).

pub mod accept;
pub mod budget;
mod camera;
mod clip;
pub mod clock;
pub mod fault;
mod frame;
pub mod host;
pub mod library;
pub mod link;
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
pub use host::{Patience, Setup};
pub use message::{Flicker, Light, Size, Source};
pub use process::{Launcher, launcher};
pub use scanner::{ZividPicture, ZividScanner, ZividShot, ZividWatch};
pub use warmth::Warmth;
