//! A recording: all that passed between the loop and what is outside of it, in order, as one MCAP file.
//!
//! The loop is a function of what comes to it: reports, requests, pictures, readings of the clock and of the store. Each
//! exchange is an [`Entry`]: what the loop `said` (a command, an event, a finding) and what it `heard`. So the loop can be
//! run again on what it heard, and what it says then compared with what it said.
//!
//! MCAP (<https://mcap.dev/spec>) holds them by topic. Pictures, points, transforms and words are messages of schemas that
//! Foxglove and Lichtblick show as they are; all else is JSON. Colours and points are kept without loss, in mm as the cameras
//! gave them: a viewer that takes them for metres shows a scene a thousand times too large, with every angle and
//! every point in its pixel as they are, which the log says at the beginning. Lenses go along, so that pictures lie over
//! points. Files that the
//! cycle worked by are attachments. A message's time rises from each to the next, so that order is kept whoever
//! rewrites the file; its sequence counts within its topic, so that what is missing is found. The last record says how
//! much there must be.
//!
//! Bytes in and out: opens no file and reads no clock. Read in this order: `topic` · `entry` · `well_known` (messages
//! of others) · `write` · `framing` (a chunk that cannot be read is refused) · `records` · `check` · `read`.

mod check;
mod entry;
mod error;
mod format;
mod framing;
mod read;
mod records;
mod shown;
mod topic;
mod well_known;
mod write;

#[cfg(test)]
mod tests;

pub use check::{Checked, check};
pub use entry::{Armed, Begin, Ending, Entry, Lost, Shot, Start};
pub use error::TapeError;
pub use format::{FORMAT, OLDEST_FORMAT};
pub use read::Entries;
pub use shown::{Lens, Mounted};
pub use topic::Topic;
pub use write::Writer;
