//! The log of the mock controller's actions, for tests and for the simulated world.

use super::mover::MoveBlocked;
use super::wire::Refusal;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool};

/// A motion command that was executed. Each command has one entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExecutedMotion {
    /// Its epoch.
    pub epoch: i32,
    /// Its id.
    pub id: i32,
    /// The axis angles at the end of the motion, or in the middle of its blend.
    pub joints: Joints,
    /// Pose of the flange at these axis angles.
    pub base_from_flange: Rigid<Base, Flange>,
    /// Time of the motion, ms since the controller's start.
    pub time_ms: u64,
    /// Whether the tool was in contact with the panel during the motion.
    pub contact: bool,
}

/// The position of the tool in contact, one sample per tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSample {
    /// Time of the sample, ms since the controller's start.
    pub time_ms: u64,
    /// The flange.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The sanding tool.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Whether both ends of the motion are in contact; otherwise the tool approaches or leaves the panel.
    pub sanding: bool,
    /// Whether the output that drives the tool was on.
    pub tool_on: bool,
}

/// The reason why the robot program stopped an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopCause {
    /// The client's abort.
    Abort,
    /// The client opened a new epoch before the end of the old one.
    Superseded,
    /// No message of the client arrived for 400 ms while commands were queued.
    Watchdog,
    /// A channel lost its client while commands were queued.
    LinkLost,
    /// The next point of the path was missing while the tool was in contact.
    Underrun,
    /// A command was refused.
    Refused(Refusal),
    /// The arm cannot follow its path any further.
    Blocked,
    /// The emergency stop.
    EStop,
    /// The guard was opened.
    Guard,
    /// The drives were switched off.
    Drives,
    /// The operating mode was changed.
    Mode,
    /// The robot program was deselected, or no robot program runs.
    Deselected,
    /// The submit interpreter does not run.
    SubmitDead,
    /// The controller was started again.
    Rebooted,
    /// The shipped programs stopped the epoch because of one of their own rules.
    Program,
    /// The shipped programs stopped the epoch because the robot program was already stopped.
    Halted,
}

impl StopCause {
    /// Returns whether the arm stops immediately on its path and the robot program is reset, without a retract.
    pub fn is_immediate(self) -> bool {
        use StopCause::{Deselected, Drives, EStop, Guard, Halted, Mode, Rebooted};
        matches!(self, EStop | Guard | Drives | Mode | Deselected | Rebooted | Halted)
    }

    /// Returns a description of the cause, for messages.
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

/// A stop of the robot program.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramStop {
    /// Time of the stop, ms since the controller's start.
    pub time_ms: u64,
    /// The epoch that the stop ended.
    pub epoch: i32,
    /// The cause of the stop.
    pub cause: StopCause,
    /// Whether the tool was in contact when the stop began.
    pub contact: bool,
    /// Additional details as a text; may be empty.
    pub detail: String,
}

/// Returns the message for a path that the arm cannot follow.
pub(super) fn path_stop_message(blocked: &MoveBlocked) -> String {
    match blocked {
        MoveBlocked::Unreachable(why) => why.to_string(),
        MoveBlocked::AxisSpeed(axis) => format!("axis {axis} would exceed its speed limit at any tool speed"),
    }
}
