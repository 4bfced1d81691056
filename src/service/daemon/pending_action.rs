//! An action in progress, and the event for which it waits.

use super::wiring::SwitchProof;
use panelprep_cell::cycle::{Action, Id};
use panelprep_kuka::eki::{CommandId, Time};

/// An action that still waits for its answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct PendingAction {
    pub id: Id,
    pub act: Action,
    pub waits: Condition,
}

/// The events for which an action can wait.
#[derive(Debug, Clone, Copy)]
pub(super) enum Condition {
    /// Waits for the robot at rest.
    Standing,
    /// The requested epoch.
    Epoch,
    /// Waits for the end of the epoch, with tool and water proven off; `done` is the number of executed waypoints,
    /// once it is reported.
    EpochEnd { done: Option<u32> },
    /// Waits until the commands for base and tool are executed and the controller reports both.
    Frames(CommandId),
    /// Waits until outputs are set and the feedback proves them.
    Feedback { last: CommandId, proof: SwitchProof },
    /// Waits until the cell has warned of the motion for long enough, counted from the first state in which the
    /// output is on.
    Warned {
        /// The command that switches the warning output on.
        last: CommandId,
        /// The end of the warning; `None` before the output is on.
        until: Option<Time>,
    },
    /// Waits for the report of the stop that ended the epoch before the command could be sent. If there is no such
    /// stop, the action has failed.
    NoEpoch {
        /// Number of robot states that are awaited until the action has failed.
        states: u8,
    },
    /// Waits until the arm is in the pose from which a linear motion may begin.
    Ready(CommandId),
    /// Waits for the end of a path.
    PathEnd,
    /// A computation.
    Computing,
    /// In lock step: waits for the robot's next state, and so for the time of the film's next picture.
    Film,
}
