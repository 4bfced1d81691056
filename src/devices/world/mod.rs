//! The simulated world: the renderer closed over the mock robot, in one memory.
//!
//! The mock controller switches water, light, extraction, tool and lens here and reads what became of them; the
//! simulated cameras have rendered what stands before them. A spot of grease that the running disc covered to nine
//! tenths is gone when the panel is wetted again. Time is the controller's. The truth is known here, for scores alone.
//!
//! - `simulated_world`: what stands in it and what changes · `signal`: what follows an output, and when · `water`: the film's time · `touch`: where the disc was
//! - `follow`: the same around a controller in another process, by what its messages tell
//!
//! The process's light does not reach the flange camera's pictures, which have a lamp of their own, nor 3D shots.
//! Not simulated: drops on a lens, a wet panel in 3D shots and in pictures of the flange camera, the arm in a picture.

mod follow;
mod signal;
mod simulated_world;
mod touch;
mod water;

pub use follow::Follower;
pub use simulated_world::{Moment, SimulatedWorld, Violation, WorldError};
pub use touch::{ContactErrors, Touched, contact_errors, step_over};
