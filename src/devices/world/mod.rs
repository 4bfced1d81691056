//! The simulated world: the renderer and the mock robot in one process, as a closed loop.
//!
//! The mock controller switches water, light, extraction, tool and lens shutter here and reads their feedbacks; the
//! views of the simulated cameras are rendered. If the running disc covered nine tenths of a spot of grease, the spot
//! is gone when the panel is wetted again. Time is the controller's. The ground truth is known here and is used only
//! for scores.
//!
//! - `simulated_world`: its contents and its cameras' views · `state`: the changing state, with effect and delay of an
//!   output, the film's time, and a line that brings parts, if the cell's file names its signals · `touch`: the disc's
//!   positions
//! - `follow`: the same world around a controller in another process, by its messages
//!
//! The process light has no influence on the flange camera's pictures, since this camera has its own lamp, nor on 3D
//! shots. Not simulated: drops on a lens, a wet panel in 3D shots and in pictures of the flange camera, the arm in a
//! picture.

mod follow;
mod simulated_world;
mod state;
mod touch;

pub use follow::Follower;
pub use simulated_world::{RobotMoment, SimulatedWorld, WorldError};
pub use state::Violation;
pub use touch::{ContactErrors, TouchedPoints, contact_errors, measure_step_over};
