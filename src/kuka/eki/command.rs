//! Commands to the robot: the nine functions of thesis Table 3.1, as values of one type.
//!
//! Field names contain the unit. When a command is queued, its values are compared with the limits that apply to every
//! controller of this type; the limits of the cell are checked before. A value out of range is refused, never clamped.

use super::ids::{Epoch, Keyword, intern_keyword};
use panelprep_base::geometry::{Joints, KukaPose};
use serde::{Deserialize, Serialize};

/// A robot function of thesis Table 3.1, with its arguments.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Command {
    /// `move_lin(pose)`: a linear motion of the TCP.
    MoveLin(MoveLin),
    /// `move_j(joints_pose)`: moves each axis to its angle; all axes arrive at the same time.
    MoveJ(MoveJ),
    /// `get_current_state()`: requests axis angles, flange pose and TCP pose, on the state channel.
    GetCurrentState,
    /// `set_base(base_frame)`: sets the base frame of the poses that follow. It is the panel's pose in the robot's
    /// base.
    SetBase(KukaPose),
    /// `set_tcp(tcp_frame)`: the TCP frame of the tool, in the flange frame.
    SetTcp(SetTcp),
    /// `set_acc_speed(acceleration, speed)`.
    SetAccSpeed(SetAccSpeed),
    /// `set_digin(number, value)`: sets an input of the controller. Inputs of a KRC are read-only, so the command is
    /// refused unless the controller maps the input to a flag ([`MappedInputs`]).
    SetDigin(Signal),
    /// `set_digout(number, value)`: sets an output after the arm has stopped at the end of the previous commands.
    SetDigout(Signal),
    /// `set_digout(number, value)` on the path: sets an output at the end of the previous motion, without a stop.
    #[strum(serialize = "set_digout")]
    SetDigoutOnPath(Signal),
    /// `call_subroutine()`: calls one of the controller's predefined subroutines, by its index.
    CallSubroutine {
        /// The index of the subroutine in the controller's own list.
        index: u16,
    },
}

/// The arguments of a linear motion of the TCP to a pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MoveLin {
    /// The TCP's target pose, in the active base.
    pub pose: KukaPose,
    /// Distance before the pose at which blending may begin, mm; 0 stops exactly at the pose.
    pub blend_mm: f64,
    /// Whether the tool touches the panel during the motion.
    pub contact: bool,
    /// Speed of the TCP for this and all following motions, m/s; `None` keeps the speed that was set before.
    pub speed_m_s: Option<f64>,
}

/// The arguments of a motion of all axes to their target angles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MoveJ {
    /// The target angles of the axes.
    pub joints: Joints,
    /// Speed of the axes as a percentage of their maximum speed.
    pub axis_speed_percent: f64,
}

/// The TCP frame of the tool, and whether a retract moves along the tool's axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SetTcp {
    /// Pose of the TCP in the flange frame.
    pub flange_from_tool: KukaPose,
    /// The kind of tool.
    pub kind: TcpKind,
}

/// The kind of equipment to which a TCP frame belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TcpKind {
    /// The flange camera, or another tool that never touches the panel.
    Other,
    /// The sanding tool; the controller retracts it along the tool's −Z axis.
    Sanding,
}

/// Speeds and accelerations of the motions that follow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SetAccSpeed {
    /// Speed of the TCP, m/s.
    pub speed_m_s: f64,
    /// Acceleration of the TCP, m/s².
    pub acceleration_m_s2: f64,
    /// Speed of the axes as a percentage of their maximum speed.
    pub axis_speed_percent: u8,
    /// Acceleration of the axes as a percentage of their maximum acceleration.
    pub axis_acceleration_percent: u8,
}

/// A digital input or output and the value to set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Signal {
    /// The number of the input or output on the controller; the first number is 1.
    pub number: u16,
    /// On or off.
    pub on: bool,
}

/// The inputs that the controller maps to flags, so that they can be set. The list is empty unless the cell file names
/// inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MappedInputs([u16; MappedInputs::MAX]);

impl MappedInputs {
    /// Maximum number of mapped inputs: the length of the controller's list.
    pub const MAX: usize = 8;

    /// Creates the list from the numbers of the inputs; returns `None` if there are more than [`MappedInputs::MAX`].
    pub fn new(numbers: impl IntoIterator<Item = u16>) -> Option<Self> {
        let mut mapped = MappedInputs::default();
        let mut places = mapped.0.iter_mut();
        for number in numbers {
            *places.next()? = number;
        }
        Some(mapped)
    }

    /// Returns whether this input is mapped to a flag and can be set.
    pub fn contains(&self, number: u16) -> bool {
        number > 0 && self.0.contains(&number)
    }
}

/// A request to the controller on the state channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Requests the current state.
    State,
    /// Reports that the client is alive, and up to which command it has sent commands.
    Heartbeat {
        /// The last command that was sent in this epoch; 0 if no command was sent.
        last_sent: u32,
    },
    /// Ends the epoch: the controller switches the tool off, brakes, discards the queued commands, and retracts if the
    /// tool is in contact. Then the next epoch begins.
    Abort {
        /// The epoch that begins after the abort.
        next: Epoch,
    },
    /// Sets the controller's outputs to a production line. The request moves nothing.
    Line {
        /// The values of the outputs as bits; the lowest bit is the first output.
        bits: u32,
    },
    /// Begins a new epoch. The request moves nothing.
    Reset {
        /// The epoch to begin.
        next: Epoch,
    },
}

/// The reason why a command cannot be sent. If a value is out of range, the message contains the value and its limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum CommandError {
    /// A value is NaN, too small or too large.
    #[error("{function}: {field} is {found}; the limits are {low} to {high}")]
    OutOfRange {
        /// The name of the function in thesis Table 3.1.
        #[serde(deserialize_with = "intern_keyword")]
        function: Keyword,
        /// The name of the value, with its unit.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
        /// The value that the caller gave.
        found: f64,
        /// Minimum valid value.
        low: f64,
        /// Maximum valid value.
        high: f64,
    },
    /// Inputs are read-only.
    #[error(
        "set_digin: input {number} cannot be set, because inputs of a KRC are read-only (KSS10388). To set an input, \
         map it to a flag: name it in [io.mapped_inputs] and in CELL_VIN of cell_config.dat"
    )]
    InputReadOnly {
        /// The input.
        number: u16,
    },
    /// `get_current_state` was queued as a command instead of being requested on the state channel.
    #[error("get_current_state is not a command for the controller's ring buffer; request it on the state channel")]
    NotACommand,
}

/// The values of a command's fields in its message, without the common header: operation, N1, N2, R1, R2 and the six
/// values of P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CommandFields {
    pub operation: i32,
    pub n: [i32; 2],
    pub r: [f64; 2],
    pub p: [f64; 6],
}

/// Maximum magnitude of a coordinate of a pose, mm.
pub(super) const MAX_COORDINATE_MM: f64 = 100_000.0;
/// Maximum magnitude of an angle of a pose or an axis, degrees: ten rotations.
pub(super) const MAX_ANGLE_DEG: f64 = 3_600.0;

impl Command {
    /// Returns the function's name in thesis Table 3.1.
    pub fn name(&self) -> &'static str {
        self.into()
    }

    /// Returns the values of the message's fields; `to_come` is the number of points of the same path that follow this
    /// point.
    pub(super) fn fields(&self, to_come: u32) -> Result<CommandFields, CommandError> {
        let check = RangeCheck { function: self.name() };
        let none = CommandFields { operation: 0, n: [0; 2], r: [0.0; 2], p: [0.0; 6] };
        Ok(match *self {
            Command::MoveJ(MoveJ { joints: j, axis_speed_percent }) => {
                let p = j.degrees();
                for (field, angle) in ["A1 (°)", "A2 (°)", "A3 (°)", "A4 (°)", "A5 (°)", "A6 (°)"].iter().zip(p)
                {
                    check.range(field, angle, -MAX_ANGLE_DEG, MAX_ANGLE_DEG)?;
                }
                let percent = check.range("axis speed (%)", axis_speed_percent, 1.0, 100.0)?;
                CommandFields { operation: 1, r: [percent, 0.0], p, ..none }
            }
            Command::MoveLin(MoveLin { pose, blend_mm, contact, speed_m_s }) => {
                let p = check.pose(pose)?;
                let blend_mm = check.range("blend (mm)", blend_mm, 0.0, 1_000.0)?;
                // In the message, the speed 0 keeps the speed that was set before.
                let speed_m_s = match speed_m_s {
                    Some(speed_m_s) => check.range("speed (m/s)", speed_m_s, 0.001, 3.0)?,
                    None => 0.0,
                };
                check.range("points to come", f64::from(to_come), 0.0, f64::from(i32::MAX))?;
                CommandFields {
                    operation: 2,
                    n: [to_come.cast_signed(), i32::from(contact)],
                    r: [blend_mm, speed_m_s],
                    p,
                }
            }
            Command::SetBase(base) => CommandFields { operation: 3, p: check.pose(base)?, ..none },
            Command::SetTcp(SetTcp { flange_from_tool, kind }) => {
                let sanding = i32::from(kind == TcpKind::Sanding);
                CommandFields { operation: 4, n: [sanding, 0], p: check.pose(flange_from_tool)?, ..none }
            }
            Command::SetAccSpeed(speed) => {
                let percent = |field, share: u8| check.range(field, f64::from(share), 1.0, 100.0);
                percent("axis speed (%)", speed.axis_speed_percent)?;
                percent("axis acceleration (%)", speed.axis_acceleration_percent)?;
                let n = [speed.axis_speed_percent, speed.axis_acceleration_percent].map(i32::from);
                let tip_m_s = check.range("speed (m/s)", speed.speed_m_s, 0.001, 3.0)?;
                let tip_m_s2 = check.range("acceleration (m/s²)", speed.acceleration_m_s2, 0.001, 20.0)?;
                CommandFields { operation: 5, n, r: [tip_m_s, tip_m_s2], ..none }
            }
            Command::SetDigout(signal) => {
                CommandFields { operation: 6, n: check.signal("output", signal)?, ..none }
            }
            Command::SetDigoutOnPath(signal) => {
                CommandFields { operation: 6, n: check.signal("output", signal)?, r: [1.0, 0.0], ..none }
            }
            Command::SetDigin(signal) => CommandFields { operation: 7, n: check.signal("input", signal)?, ..none },
            Command::CallSubroutine { index } => {
                check.range("index", f64::from(index), 0.0, 1_000.0)?;
                CommandFields { operation: 8, n: [i32::from(index), 0], ..none }
            }
            Command::GetCurrentState => return Err(CommandError::NotACommand),
        })
    }
}

/// Checks the arguments of one function against their limits.
struct RangeCheck {
    function: &'static str,
}

impl RangeCheck {
    /// Returns the value if it is within the limits; NaN is an error.
    fn range(&self, field: &'static str, found: f64, low: f64, high: f64) -> Result<f64, CommandError> {
        let function = self.function;
        if found >= low && found <= high {
            Ok(found)
        } else {
            Err(CommandError::OutOfRange { function, field, found, low, high })
        }
    }

    fn signal(&self, field: &'static str, Signal { number, on }: Signal) -> Result<[i32; 2], CommandError> {
        self.range(field, f64::from(number), 1.0, 4096.0)?;
        Ok([i32::from(number), i32::from(on)])
    }

    fn pose(&self, pose: KukaPose) -> Result<[f64; 6], CommandError> {
        for (field, mm) in [("X (mm)", pose.x_mm), ("Y (mm)", pose.y_mm), ("Z (mm)", pose.z_mm)] {
            self.range(field, mm, -MAX_COORDINATE_MM, MAX_COORDINATE_MM)?;
        }
        for (field, deg) in [("A (°)", pose.a_deg), ("B (°)", pose.b_deg), ("C (°)", pose.c_deg)] {
            self.range(field, deg, -MAX_ANGLE_DEG, MAX_ANGLE_DEG)?;
        }
        Ok([pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg])
    }
}
