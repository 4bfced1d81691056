//! A recording: all data between the loop and its environment, in order, as one MCAP file.
//!
//! The loop is a function of its inputs: reports, requests, pictures, readings of the clock and of the store. Each
//! exchange is an [`Entry`]: the output of the loop, `said` (a command, an event, a finding), and its input, `heard`.
//! The loop can therefore be run again on the recorded inputs, and its outputs can be compared with the recorded ones.
//!
//! MCAP (<https://mcap.dev/spec>) stores them by topic. Pictures, points, transforms and texts are messages of schemas
//! that Foxglove and Lichtblick show; all other messages are JSON. Colours and points are stored without loss, in mm as
//! the cameras measured them. A viewer that interprets them as metres shows a scene a thousand times too large, but
//! with correct angles and with every point in its pixel; the log states this at the beginning. Lenses are included, so
//! that a viewer can show points over the pictures. The files that the cycle used are attachments. The time increases
//! from message to message, so that any program that rewrites the file preserves the order. The sequence number of a
//! message counts within its topic, so that missing messages are detected. The last record states the number of
//! messages.
//!
//! This module converts bytes: it opens no file and reads no clock. Read in this order: `topic` (also the messages of
//! Foxglove's schemas) · `entry` · `write` · `read` (also the check of a recording).

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
