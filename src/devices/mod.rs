//! What stands outside of the program: the robot's controller and the cameras, real or played.
//!
//! - [`mock`]: a stand-in for the robot's controller
//! - [`robot`]: the link to a controller, over TCP

pub mod mock;
pub mod robot;
