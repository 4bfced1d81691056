//! A log of what the controller did, for tests and for the simulated world.

use super::mover::MoveBlocked;
use super::wire::Refusal;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool};

/// A motion command that was executed; each command has one entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExecutedMotion {
    /// Its epoch.
    pub epoch: i32,
    /// Its id.
    pub id: i32,
    /// The axis angles at the end of the move, or in the middle of its blend.
    pub joints: Joints,
    /// Pose of the flange at these axes.
    pub base_from_flange: Rigid<Base, Flange>,
    /// Time of the motion, ms since the controller's start.
    pub time_ms: u64,
    /// Whether the motion was a move in contact.
    pub contact: bool,
}

/// The tool's position at one tick of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSample {
    /// Time of the sample, ms since the controller's start.
    pub time_ms: u64,
    /// The flange.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The sanding tool.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Both ends of this segment are in contact; otherwise the tool lands or leaves.
    pub sanding: bool,
    /// Whether the tool's output was on.
    pub tool_on: bool,
}

/// The reason why the program stopped an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopCause {
    /// The client's abort.
    Abort,
    /// A new epoch was opened while the old one was not at its end.
    Superseded,
    /// No application frame came for 400 ms while a command was queued.
    Watchdog,
    /// A channel lost its client while a command was queued.
    LinkLost,
    /// The next point was missing in contact.
    Underrun,
    /// A command was refused.
    Refused(Refusal),
    /// The arm cannot continue along its path.
    Blocked,
    /// The emergency stop.
    EStop,
    /// The guard was opened.
    Guard,
    /// The drives were switched off.
    Drives,
    /// The mode switch was turned.
    Mode,
    /// The robot program was deselected, or none runs.
    Deselected,
    /// The submit interpreter does not run.
    SubmitDead,
    /// The controller was started again.
    Rebooted,
    /// The shipped programs stopped the epoch by one of their rules.
    Program,
    /// The shipped programs stopped the epoch because the robot program was already stopped.
    Halted,
}

impl StopCause {
    /// Returns whether the arm stops at once on its path and the robot program is reset, without a retract.
    pub fn is_immediate(self) -> bool {
        use StopCause::{Deselected, Drives, EStop, Guard, Halted, Mode, Rebooted};
        matches!(self, EStop | Guard | Drives | Mode | Deselected | Rebooted | Halted)
    }

    /// Returns the description for messages.
    pub fn describe(self) -> &'static str {
        match self {
            StopCause::Abort => "the client ended the epoch",
            StopCause::Superseded => "a new epoch began before the end of this epoch",
            StopCause::Watchdog => "the client sent nothing while commands were queued",
            StopCause::LinkLost => "a channel lost its client while commands were queued",
            StopCause::Underrun => "the next waypoint was missing while the tool was in contact",
            StopCause::Refused(_) => "a command was refused",
            StopCause::Blocked => "the arm cannot continue along its path",
            StopCause::EStop => "emergency stop",
            StopCause::Guard => "the guard was opened",
            StopCause::Drives => "the drives were switched off",
            StopCause::Mode => "the operating mode was changed",
            StopCause::Deselected => "the robot program was deselected, or none runs",
            StopCause::SubmitDead => "the submit interpreter does not run",
            StopCause::Rebooted => "the controller was restarted",
            StopCause::Program => "the controller's programs ended the epoch by one of their rules",
            StopCause::Halted => "the robot program was already stopped",
        }
    }
}

/// A stop by the program.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramStop {
    /// Time of the stop, ms since the controller's start.
    pub time_ms: u64,
    /// The epoch that the stop ended.
    pub epoch: i32,
    /// Cause of the stop.
    pub cause: StopCause,
    /// Whether the stop began in contact.
    pub contact: bool,
    /// More detail in words, if there is any.
    pub detail: String,
}

/// Returns a message for a path that cannot be continued.
pub(super) fn path_stop_message(blocked: &MoveBlocked) -> String {
    match blocked {
        MoveBlocked::Unreachable(why) => why.to_string(),
        MoveBlocked::AxisSpeed(axis) => format!("axis {axis} would exceed its speed limit at any tool speed"),
    }
}
