//! What stands outside of the program: the robot's controller and the cameras, real or played.
//!
//! - [`robot`]: the link to a controller, over TCP

pub mod robot;
