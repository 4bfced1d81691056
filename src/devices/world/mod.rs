//! The simulated world: the renderer and the mock robot in one process, as a closed loop.
//!
//! The mock controller switches water, light, extraction, tool and lens shutter of this world and reads their
//! feedbacks; the views of the simulated cameras are rendered. If the running disc has covered nine tenths of a greasy
//! spot, the spot is removed the next time the panel is wetted. The time is the controller's. The ground truth is known
//! here and is used only for scores.
//!
//! - `simulated_world`: its contents and the views of its cameras · `state`: the state that changes, with the effect
//!   and delay of each output, the time of the film, and a production line that brings parts, if the cell file names
//!   its signals · `touch`: the positions of the disc
//! - `follow`: the same world around a controller in another process, from its state messages
//!
//! The process light affects neither the pictures of the flange camera, which has its own lamp, nor 3D scans. Not
//! simulated: drops on a lens, a wet panel in 3D scans and in pictures of the flange camera, the arm in a picture.

mod follow;
mod simulated_world;
mod state;
mod touch;

pub use follow::Follower;
pub use simulated_world::{RobotMoment, SimulatedWorld, WorldError};
pub use state::Violation;
pub use touch::{ContactErrors, TouchedPoints, contact_errors, measure_step_over};
