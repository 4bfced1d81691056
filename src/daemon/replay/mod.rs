//! A cycle's recording: written while the cycle runs, and the cycle run again on what was recorded.
//!
//! A `recorded_port` stands around each of the loop's ports and writes down what passes (`tape` says what that is), while the
//! `switch` says that a cycle is recorded; `queue` takes it to a thread of its own, so that neither loop nor link ever waits
//! for a disk. The `player` is the same ports without a cell: it answers each command with what came then, and notes where the
//! loop now does something else (`difference`). `form` says how commands and answers stand in a recording, `earlier_form` how findings stood in those of earlier programs.

mod difference;
mod earlier_form;
mod form;
mod player;
mod queue;
mod recorded_port;
mod switch;

#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use player::{Played, Player};
pub use queue::{RECORDING_FLOOR_MB, Recorded, Recording, Stands, too_full};
pub use recorded_port::RecordedPort;
pub use switch::{RecordingPlan, RecordingSwitch, free_mb, recording_file, recordings};
