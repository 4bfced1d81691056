//! The path that was sent last.

use crate::cycle::{Id, Motion, Path};
use crate::eki::CommandId;
use crate::geometry::{Base, Joints, Rigid, Tool};

/// The end of a path.
#[derive(Debug, Clone, Copy)]
pub(super) enum End {
    Joints(Joints),
    Tip(Rigid<Base, Tool>),
}

/// The path that was sent last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sent {
    pub id: Id,
    pub motion: Motion,
    pub first: CommandId,
    pub last: CommandId,
    pub end: End,
    pub told: u32,
}

impl Sent {
    /// Returns which path was sent.
    pub fn path(&self) -> Path {
        self.motion.path
    }

    /// Returns the number of the command for the path's first waypoint.
    pub fn first(&self) -> CommandId {
        self.first
    }

    /// Returns the number of executed waypoints if all commands up to this one are executed.
    pub fn waypoints(&self, done: CommandId) -> u32 {
        if matches!(self.motion.path, Path::Contact | Path::Air) {
            (done.0 + 1).saturating_sub(self.first.0).min(self.motion.waypoints)
        } else {
            u32::from(done >= self.last) * self.motion.waypoints
        }
    }
}
