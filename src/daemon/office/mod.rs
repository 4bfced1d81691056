//! The cell's records on their way to the office: a thread of its own that reads what the store has for the office, sends it to the
//! broker, and asks what the office has. Nothing in the cell waits for it, and nothing that the office says changes what the cell
//! does: it is sent again, or it is an alarm.
//!
//! `sending` is one round of it, `progress_file` what is remembered between two processes, `status` what people are told.

mod parts;
mod sending;
mod state;
mod status;

pub use parts::OfficeParts;
pub use status::OfficeStatus;

use super::background::Worker;
use sending::Sender;

/// The sender while it works; it ends when this is dropped.
#[derive(Debug)]
pub struct OfficeSender(#[expect(dead_code, reason = "it ends the thread")] Worker);

impl OfficeSender {
    /// Starts it.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(parts: OfficeParts) -> std::io::Result<Self> {
        Worker::start("office", "the way of records to the office", move || Sender::new(&parts)).map(OfficeSender)
    }
}
