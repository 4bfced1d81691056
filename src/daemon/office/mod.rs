//! The cell's records on their way to the office: a thread of its own reads the data that the store has for the
//! office, sends it to the broker, and asks which data the office has. Nothing in the cell waits for it, and no
//! answer of the office changes the cell's work: data is sent again, or there is an alarm.
//!
//! `sending` is one round, `status` is the report to people; the progress is stored in the store's folder
//! (`progress_file`).

mod parts;
mod resend;
mod sending;
mod state;
mod status;

pub use parts::OfficeParts;
pub use status::OfficeStatus;

use super::background::{Background, Plan};
use sending::Sender;

/// The thread that sends to the office; it ends when this is dropped.
#[derive(Debug)]
pub struct OfficeSender {
    _background: Background,
}

impl OfficeSender {
    /// Starts it.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn start(parts: OfficeParts) -> std::io::Result<Self> {
        let plan =
            Plan { name: "office", what: "the way of records to the office", blocking: 2, stack_bytes: None };
        Ok(OfficeSender { _background: Background::in_rounds(plan, move || Sender::new(&parts))? })
    }
}
