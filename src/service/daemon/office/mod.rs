//! Transfer of the cell's records to the office: a separate thread reads the data that the store has for the office,
//! sends it to the broker, and asks which data the office has. Nothing in the cell waits for this thread, and no
//! answer of the office changes the cell's work: data is only sent again, or an alarm is raised.
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
    /// Starts the sender.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn start(parts: OfficeParts) -> std::io::Result<Self> {
        let plan = Plan {
            name: "office",
            task: "the transfer of records to the office",
            blocking_threads: 2,
            stack_bytes: None,
        };
        Ok(OfficeSender { _background: Background::spawn_rounds(plan, move || Sender::new(&parts))? })
    }
}
