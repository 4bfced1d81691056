//! A recording: all data that the control loop and its environment exchange, in order, in one MCAP file.
//!
//! The control loop is a function of its inputs: reports, requests, pictures, times, and data from the store. Each
//! exchange is an [`Entry`] with the output of the loop, `said` (a command, an event, a finding), and its input,
//! `heard`. Therefore the loop can be executed again with the recorded inputs, and its outputs can be compared with the
//! recorded ones.
//!
//! The MCAP file (<https://mcap.dev/spec>) stores the entries by topic. Pictures, points, transforms and log texts have
//! message schemas that Foxglove and Lichtblick display; all other messages are JSON. Colours and points are stored
//! without loss, in mm as measured by the cameras. A viewer that interprets them as metres displays a scene that is a
//! thousand times too large, but with correct angles and with every point in its pixel; the first log message states
//! this. The lenses are recorded, so that a viewer can display points on the pictures. The files that the cycle used
//! are attachments. The time increases from message to message, so that a program that rewrites the file keeps the
//! order. The sequence number of a message is counted within its topic, so that missing messages are detected. The last
//! record states the number of messages.
//!
//! This module converts bytes: it opens no files and uses no clock. Read the files in this order: `topic` (also the
//! messages of Foxglove's schemas) · `entry` · `write` · `read` (also the check of a recording).

mod entry;
mod error;
mod read;
mod topic;
mod write;

#[cfg(test)]
mod tests;

pub use entry::{
    ArmedDeadline, Entry, FramePose, Lens, LoopMemoryStart, LostEntries, RecordingEnd, RecordingStart, Shot,
};
pub use error::{FORMAT, OLDEST_FORMAT, TapeError};
pub use read::{CheckedRecording, EntryReader, check_recording};
pub use topic::Topic;
pub use write::Writer;
