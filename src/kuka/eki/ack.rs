//! The controller's acknowledgements: which commands it has received and executed, and the first command that it
//! refused.

use super::ids::{CommandId, Epoch};
use super::schema::{Field, integer_field};
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// An acknowledgement. The counts refer to its epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ack {
    /// The last command received; all commands before it were received too.
    pub received: CommandId,
    /// The last command executed.
    pub done: CommandId,
    /// Number of free entries in the controller's ring.
    pub free: u32,
    /// The first command refused, and why.
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
    /// Creates an acknowledgement from the values of [`ACK`], which are in range, and integers where required.
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
