//! The controller's messages. A state message contains the values of one instant. An acknowledgement states which
//! commands the controller has received and executed, and the first command that it refused.

use super::command::{MAX_ANGLE_DEG, MAX_COORDINATE_MM};
use super::ids::{CommandId, Epoch};
use super::schema::{Field, integer_field, number_field};
use panelprep_base::geometry::{Joints, KukaPose};
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// The operating mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// T1: manual mode with reduced speed, at most 250 mm/s.
    T1,
    /// T2: manual mode with full speed.
    T2,
    /// AUT: automatic mode, started on the controller.
    #[strum(serialize = "AUT")]
    Automatic,
    /// EXT: automatic mode, started by an external signal.
    #[strum(serialize = "EXT")]
    External,
}

impl Mode {
    /// Returns the name of the mode, as the controller displays it.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The speed override for which contact paths are planned, %. At a lower override the dwell time of the disc is longer.
pub const CONTACT_OVERRIDE_PERCENT: u8 = 100;

/// The controller's state at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Time since the controller's start, ms.
    pub time_ms: u32,
    /// The number of this state message.
    pub sequence: u32,
    /// The number of the last request to which the controller has replied.
    pub answered: u32,
    /// The epoch in which the controller is.
    pub epoch: Epoch,
    /// A number that changes with each start of the controller.
    pub boot: i32,
    /// Checksum of the programs on the controller.
    pub programs_checksum: i32,
    /// Operating mode.
    pub mode: Mode,
    /// Whether the drives are on.
    pub drives_on: bool,
    /// Whether an emergency stop is pressed.
    pub emergency_stop: bool,
    /// Whether the guard is closed.
    pub guard_closed: bool,
    /// Whether the arm moves.
    pub moving: bool,
    /// Whether a motion could start.
    pub motion_possible: bool,
    /// Whether the base was set in this epoch.
    pub base_set: bool,
    /// Whether the tool was set in this epoch.
    pub tool_set: bool,
    /// Whether the robot program on the controller has stopped this epoch by itself.
    pub stopped: bool,
    /// The values of the mapped inputs, one bit each.
    pub inputs: u32,
    /// The values of the mapped outputs, one bit each.
    pub outputs: u32,
    /// The last command executed in this epoch.
    pub done: CommandId,
    /// Number of underruns: how often the controller ran out of commands before the end of a path.
    pub underruns: u32,
    /// The program override, `$OV_PRO`: the percentage of each commanded speed at which the arm moves, %.
    pub override_percent: u8,
    /// The measured axis angles.
    pub joints: Joints,
    /// The measured pose of the tool centre point in the active base.
    pub base_from_tcp: KukaPose,
    /// Pose of the active base in the robot's own base.
    pub active_base: KukaPose,
    /// Pose of the active tool in the flange frame.
    pub flange_from_tool: KukaPose,
}

const MAX_WHOLE_DIGITS: usize = 13;

pub(super) const STATE: [Field; 37] = [
    integer_field("St/@T", 0, i32::MAX),
    integer_field("St/@Seq", 0, i32::MAX),
    integer_field("St/@Re", 0, i32::MAX),
    integer_field("St/@Ep", 0, i32::MAX),
    integer_field("St/@Boot", i32::MIN, i32::MAX),
    integer_field("St/@Sum", i32::MIN, i32::MAX),
    integer_field("St/@Mode", 1, 4),
    integer_field("St/@Flags", 0, 255),
    integer_field("St/@In", 0, i32::MAX),
    integer_field("St/@Out", 0, i32::MAX),
    integer_field("St/@Done", 0, i32::MAX),
    integer_field("St/@Under", 0, i32::MAX),
    integer_field("St/@Ov", 0, 100),
    number_field("St/J/@A1", MAX_ANGLE_DEG),
    number_field("St/J/@A2", MAX_ANGLE_DEG),
    number_field("St/J/@A3", MAX_ANGLE_DEG),
    number_field("St/J/@A4", MAX_ANGLE_DEG),
    number_field("St/J/@A5", MAX_ANGLE_DEG),
    number_field("St/J/@A6", MAX_ANGLE_DEG),
    number_field("St/Tcp/@X", MAX_COORDINATE_MM),
    number_field("St/Tcp/@Y", MAX_COORDINATE_MM),
    number_field("St/Tcp/@Z", MAX_COORDINATE_MM),
    number_field("St/Tcp/@A", MAX_ANGLE_DEG),
    number_field("St/Tcp/@B", MAX_ANGLE_DEG),
    number_field("St/Tcp/@C", MAX_ANGLE_DEG),
    number_field("St/Base/@X", MAX_COORDINATE_MM),
    number_field("St/Base/@Y", MAX_COORDINATE_MM),
    number_field("St/Base/@Z", MAX_COORDINATE_MM),
    number_field("St/Base/@A", MAX_ANGLE_DEG),
    number_field("St/Base/@B", MAX_ANGLE_DEG),
    number_field("St/Base/@C", MAX_ANGLE_DEG),
    number_field("St/Tool/@X", MAX_COORDINATE_MM),
    number_field("St/Tool/@Y", MAX_COORDINATE_MM),
    number_field("St/Tool/@Z", MAX_COORDINATE_MM),
    number_field("St/Tool/@A", MAX_ANGLE_DEG),
    number_field("St/Tool/@B", MAX_ANGLE_DEG),
    number_field("St/Tool/@C", MAX_ANGLE_DEG),
];

/// The boot ids of a mock controller. A real controller's programs compute the boot id from the date, in seconds; the
/// values of this range correspond to day 0 of month 0, which no clock shows. 0 is excluded, because a controller whose
/// programs have not run `CELL_INIT` reports 0, and such a controller may be real.
const MOCK_BOOT_IDS: std::ops::Range<i32> = 1..86_400;

impl State {
    /// Returns whether a mock controller sent this state. Such a state is no evidence about a real controller.
    pub fn is_simulated(&self) -> bool {
        MOCK_BOOT_IDS.contains(&self.boot)
    }

    /// Returns whether the controller does not know the pose of the TCP: before the robot program is started, all
    /// values of the pose are 0.
    pub fn tip_is_unknown(&self) -> bool {
        self.base_from_tcp == KukaPose::default()
    }

    /// Creates a state from the values of the fields [`STATE`]. The values are in range, and integers where the field
    /// requires an integer.
    pub(super) fn from_values(values: &[f64]) -> Option<Self> {
        let (whole, poses) = values.split_at_checked(MAX_WHOLE_DIGITS)?;
        let [
            time,
            sequence,
            answered,
            epoch,
            boot,
            sum,
            mode,
            flags,
            inputs,
            outputs,
            done,
            underruns,
            override_percent,
        ] = *<&[f64; MAX_WHOLE_DIGITS]>::try_from(whole).ok()?;
        let [joints, tcp, base, tool] = poses.as_chunks::<6>().0 else { return None };
        let flag = |bit: u32| (flags as u32) >> bit & 1 == 1;
        let [a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg] = *joints;
        let modes = [Mode::T1, Mode::T2, Mode::Automatic, Mode::External];
        Some(State {
            time_ms: time as u32,
            sequence: sequence as u32,
            answered: answered as u32,
            epoch: Epoch(epoch as u32),
            boot: boot as i32,
            programs_checksum: sum as i32,
            mode: *modes.get((mode as usize).checked_sub(1)?)?,
            drives_on: flag(0),
            emergency_stop: !flag(1),
            guard_closed: flag(2),
            moving: flag(3),
            motion_possible: flag(4),
            base_set: flag(5),
            tool_set: flag(6),
            stopped: flag(7),
            inputs: inputs as u32,
            outputs: outputs as u32,
            done: CommandId(done as u32),
            underruns: underruns as u32,
            override_percent: override_percent as u8,
            joints: Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg },
            base_from_tcp: pose(tcp),
            active_base: pose(base),
            flange_from_tool: pose(tool),
        })
    }
}

fn pose(&[x_mm, y_mm, z_mm, a_deg, b_deg, c_deg]: &[f64; 6]) -> KukaPose {
    KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }
}

/// An acknowledgement of commands. Its command numbers belong to its epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ack {
    /// The last command that was received; all commands before it were received, too.
    pub received: CommandId,
    /// The last command that was executed.
    pub done: CommandId,
    /// Number of free entries in the controller's ring buffer.
    pub free: u32,
    /// The first command that was refused, and the reason.
    pub refused: Option<(CommandId, Refusal)>,
    /// The epoch to which the acknowledgement belongs.
    pub epoch: Epoch,
}

/// The reason why the controller refused a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, thiserror::Error, VariantArray)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// `Err` 1.
    #[error("an ID is missing before this command")]
    IdGap,
    /// `Err` 2.
    #[error("the command belongs to another epoch")]
    WrongEpoch,
    /// `Err` 3.
    #[error("the controller's ring buffer of commands is full")]
    RingFull,
    /// `Err` 4.
    #[error("the controller does not know this operation")]
    UnknownOperation,
    /// `Err` 5.
    #[error("a value is out of range")]
    OutOfRange,
    /// `Err` 6.
    #[error("base or tool is not set in this epoch")]
    FramesNotSet,
    /// `Err` 7.
    #[error("inputs are read-only")]
    InputReadOnly,
    /// `Err` 8.
    #[error("the pose cannot be reached, or an axis would leave its range")]
    NotReachable,
    /// `Err` 9.
    #[error("the robot's operating mode does not allow motion")]
    NoMotionMode,
    /// `Err` 10.
    #[error("the controller has stopped this epoch")]
    Stopped,
    /// `Err` 11.
    #[error("contact needs an override of 100 %, but the override has another value or was changed")]
    Override,
    /// `Err` 12.
    #[error(
        "the line ends outside of the controller's own box, or is longer in contact than the controller's maximum step"
    )]
    OutsideBox,
}

impl Refusal {
    const IN_ORDER: &'static [Refusal] = <Self as VariantArray>::VARIANTS;
}

pub(super) const ACK: [Field; 6] = [
    integer_field("Ack/@Rx", 0, i32::MAX),
    integer_field("Ack/@Done", 0, i32::MAX),
    integer_field("Ack/@Free", 0, i32::MAX),
    integer_field("Ack/@Err", 0, 12),
    integer_field("Ack/@ErrId", 0, i32::MAX),
    integer_field("Ack/@Ep", 0, i32::MAX),
];

impl Ack {
    /// Creates an acknowledgement from the values of the fields [`ACK`]. The values are in range, and integers where
    /// the field requires an integer.
    pub(super) fn from_values(values: &[f64]) -> Option<Self> {
        let [received, done, free, error, error_id, epoch] = *<&[f64; 6]>::try_from(values).ok()?;
        let refusal = (error as usize).checked_sub(1).and_then(|index| Refusal::IN_ORDER.get(index));
        Some(Ack {
            received: CommandId(received as u32),
            done: CommandId(done as u32),
            free: free as u32,
            refused: refusal.map(|&refusal| (CommandId(error_id as u32), refusal)),
            epoch: Epoch(epoch as u32),
        })
    }
}
