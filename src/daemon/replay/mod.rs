//! A cycle's recording: written while the cycle runs, and the cycle run again on the recorded data.
//!
//! A `recorded_port` surrounds each of the loop's ports and writes down the data that passes (`tape` defines it)
//! while the `switch` reports that a cycle is recorded. The `queue` passes it to a thread of its own, so that
//! neither loop nor link ever waits for a disk. The `player` provides the same ports without a cell: it answers
//! each command with the recorded answer, and notes the places where the loop now acts differently (`difference`).
//! `form` defines the commands and answers in a recording, `earlier_form` the findings in recordings of earlier
//! programs.

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
pub use queue::{RECORDING_FLOOR_MB, Recorded, Recording, RecordingStatus, disk_full_message};
pub use recorded_port::RecordedPort;
pub use switch::{RecordingPlan, RecordingSwitch, free_mb, recording_file, recordings};
