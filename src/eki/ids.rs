//! The numbers of commands and of the epochs in which they are sent.

/// A command's number, contiguous from 1 in each epoch; 0 is none.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct CommandId(pub u32);

/// A span of commands that begins with a reset and ends with an abort, a stop or the link. An ended epoch never
/// moves the robot.
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
/// messages would be needed to use the count up.
pub const EPOCH_STEP: u32 = 1_000_000;
/// A controller that begins a connection with a higher epoch is refused: hardly any would be left to count.
pub(super) const MAX_EPOCH: u32 = 2_000_000_000;

/// Numbers on the wire are 32 bits with a sign.
pub(super) const LAST_NUMBER: u32 = i32::MAX.cast_unsigned();
