//! The numbers of commands and of the epochs in which they are sent.

/// A command's number, contiguous from 1 in each epoch; 0 means no command.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct CommandId(pub u32);

/// A sequence of commands that begins with a reset and ends with an abort, a stop or the loss of the link. An ended
/// epoch never moves the robot.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct Epoch(pub u32);

impl std::fmt::Display for CommandId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl std::fmt::Display for Epoch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// The maximum by which one request may raise the controller's epoch, and by which one message may be ahead of the
/// known epoch. A cell opens a few thousand epochs a day, so no real epoch is farther away. Two thousand wrong
/// messages would be needed to exhaust the counter.
pub const MAX_EPOCH_STEP: u32 = 1_000_000;
/// A controller that begins a connection with a higher epoch is refused, since hardly any numbers would be left.
pub(super) const MAX_EPOCH: u32 = 2_000_000_000;

/// The largest number: numbers on the wire are signed 32-bit integers.
pub(super) const LAST_NUMBER: u32 = i32::MAX.cast_unsigned();
