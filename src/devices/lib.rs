//! The devices: the robot's controller and the cameras, real, simulated or recorded.
//!
//! - [`acf`]: the compliant tool, over TCP or simulated
//! - [`cameras`]: the data of a shot; simulated and recorded cameras
//! - [`gige`]: GigE Vision cameras
//! - [`mock`]: a mock of the robot's controller
//! - [`robot`]: the link to a controller, over TCP
//! - [`world`]: the simulated world around the mock
//! - [`zivid`]: the Zivid 3D camera, through its SDK in a process of its own
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

/// Width and height, px, that represent a camera whose size is not known. No camera has this size, so a camera that is
/// opened with it refuses and reports its own size.
pub const UNKNOWN_PX: [usize; 2] = [0, 0];
