//! Checks whether the arm can follow a path: within its limits and margins, in one configuration, at the requested
//! speed.
//!
//! A path of linear motions is divided into steps of at most 10 mm and 3°. Each step continues with the axis solution
//! nearest to the one before. So a path keeps the configuration that it begins with, and a flip shows as a jump. The
//! configuration is the arm's current one, or, before it is known, the one with the most room left. Every step must
//! keep the margins of the cell's file from the axis limits and from the three singularities (wrist, stretched elbow,
//! wrist over axis 1). It must also keep the speed and acceleration limits of each axis, and the distances from the
//! keep-out boxes. Corners that are rounded over b mm change speed in 2 b / feed; if the arm stops, the controller's
//! own ramp applies. A path is rejected as a whole.

mod follow;
mod infeasible;
#[cfg(test)]
mod tests;

pub use super::obstacles::Obstacles;
pub use follow::{ArmTravel, check_retracts, follow_path, helpful_shift, joint_motion, postures, retract};
pub use infeasible::{Infeasibility, PathLine, ReachFault, Singularity, departing, interpolate_pose, is_clear};
