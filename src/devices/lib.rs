//! The devices of the cell (robot controller, compliant tool, cameras), each real, simulated or recorded.
//!
//! - [`acf`]: the compliant tool, over TCP or simulated
//! - [`cameras`]: the data of pictures and scans; simulated and recorded cameras
//! - [`gige`]: GigE Vision cameras
//! - [`mock`]: a mock of the robot controller
//! - [`robot`]: the link to a robot controller, over TCP
//! - [`world`]: the simulated world around the mock controller
//! - [`zivid`]: the Zivid 3D camera, through its SDK in a separate process
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod acf;
pub mod cameras;
pub mod gige;
pub mod mock;
pub mod robot;
pub mod world;
pub mod zivid;

/// Placeholder for an unknown picture size, px. No camera has this size, so a camera that is opened with it refuses and
/// reports its actual size.
pub const UNKNOWN_PX: [usize; 2] = [0, 0];
