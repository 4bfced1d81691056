//! The recording of a cycle, and the replay of a cycle from a recording.
//!
//! A [`RecordedPort`] wraps each port of the loop and records the data that pass (`tape` defines the file format) while
//! the recording `switch` is on. The `queue` passes the data to a separate thread, so that neither the loop nor the
//! connection to the robot ever waits for a disk. The `player` provides the same ports without a cell: it answers each
//! command with the recorded answer, and reports each point at which the loop now acts differently ([`Difference`]).
//! `form` defines the commands and answers in a recording.

mod form;
mod player;
mod queue;
mod switch;

#[cfg(test)]
mod tests;

pub use form::RecordedPort;
pub use player::{Difference, Player, ReplayResult};
pub use queue::Recording;
pub use switch::RecordingSwitch;
