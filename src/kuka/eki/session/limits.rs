//! The limits of a link, and the reasons why a command is not queued.

use crate::eki::command::{CommandError, MappedInputs};
use crate::eki::ids::Epoch;
use crate::eki::word::{Keyword, intern_keyword};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// The limits of a link (`design.md`, "Limits").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkLimits {
    /// Longest motion sent and not yet executed.
    pub window: Duration,
    /// Largest number of commands sent and not yet executed.
    pub window_commands: usize,
    /// Number of points that are sent together when a path starts, and that are always sent ahead, whatever their
    /// duration.
    pub min_points: usize,
    /// Interval between heartbeats.
    pub heartbeat: Duration,
    /// Duration of silence after which the epoch is ended, while anything is queued.
    pub watchdog: Duration,
    /// The inputs that can be set.
    pub mapped_inputs: MappedInputs,
    /// Bits of the state's outputs that do harm without supervision: tool and water. While one is on, silence
    /// counts as it does while commands are queued.
    pub harmful_outputs: u32,
}

impl Default for LinkLimits {
    fn default() -> Self {
        LinkLimits {
            window: Duration::from_secs(1),
            window_commands: 50,
            min_points: 5,
            heartbeat: Duration::from_millis(100),
            watchdog: Duration::from_millis(400),
            mapped_inputs: MappedInputs::default(),
            harmful_outputs: 0,
        }
    }
}

/// The reason why a command was not queued. No part of the command was sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum QueueError {
    /// No controller.
    #[error("there is no connection to the controller")]
    NotConnected,
    /// A new epoch would begin while the robot moves.
    #[error("the robot is still moving; abort the motion, and wait for standstill")]
    NotStanding,
    /// No epoch is open.
    #[error("no epoch is open; open a new epoch after each start, stop or fault")]
    NoEpoch,
    /// The next epoch is too far above the controller's epoch.
    #[error(
        "the next epoch would be {next}, but the controller is in epoch {found}, and at most {most} more can be \
         reached. If the controller was replaced: deselect its programs, set CELL_EP on the controller to {above}, and \
         perform a cold start"
    )]
    EpochTooFar {
        /// The next epoch, from the epochs opened before.
        next: u64,
        /// Epoch of the controller.
        found: Epoch,
        /// Largest allowed distance between the two epochs.
        most: u32,
        /// The epoch that should be set on the controller.
        above: u64,
    },
    /// Linear motions need both frames, base and tool.
    #[error("move_lin needs base and tool to be set in this epoch; {missing} is not set")]
    FramesNotSet {
        /// The frame that is missing.
        #[serde(deserialize_with = "intern_keyword")]
        missing: Keyword,
    },
    /// A path without points.
    #[error("the path has no points")]
    EmptyPath,
    /// Too many commands.
    #[error("the epoch would have more than {most} commands; open a new epoch")]
    IdsExhausted {
        /// The last id.
        most: u32,
    },
    /// The correction of the arm needs the axis angles at the point, and the point cannot be reached with any axis
    /// angles.
    #[error(
        "point {point} cannot be reached with any axis angles, so the robot correction cannot be applied to this point"
    )]
    Uncorrected {
        /// Number of the point, from 1.
        point: usize,
    },
    /// A command that no controller can execute.
    #[error(transparent)]
    Command(#[from] CommandError),
}
