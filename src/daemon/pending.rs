//! An act that is under way, and what it waits for.

use super::wiring::Proof;
use crate::cycle::{Act, Id};
use crate::eki::{CommandId, Time};

/// An act that still waits for its answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pending {
    pub id: Id,
    pub act: Act,
    pub waits: Waits,
}

/// What is waited for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Waits {
    /// The robot at rest.
    Standing,
    /// The requested epoch.
    Epoch,
    /// The end of the epoch, with tool and water proven off; the number of executed waypoints, once it is reported.
    EpochEnd { done: Option<u32> },
    /// Base and tool, executed and echoed.
    Frames(CommandId),
    /// Outputs that are set, and the feedback.
    Feedback { last: CommandId, proof: Proof },
    /// That the cell has warned of the motion for long enough, from the first state on in which the output is on.
    Warned {
        /// The command that switches it on.
        last: CommandId,
        /// Until then; `None` before it is on.
        until: Option<Time>,
    },
    /// The stop that ended the epoch before the command could be sent; without one the act has failed.
    NoEpoch {
        /// States of the robot until then.
        states: u8,
    },
    /// The pose from which a line may begin.
    Ready(CommandId),
    /// The end of a path.
    PathEnd,
    /// What is computed.
    Computing,
    /// In lock step: the robot's next state, and with it the time of the film's next picture.
    Film,
}
