//! Signed records by HTTP to a quality system: the files that `panelprep record export` writes, each put below an
//! address of its own.
//!
//! The transfer runs on a thread of its own, for which nothing waits. Each signature's files are put in this order:
//! the files that the record names, the page, the signature, and last the record itself. So if a record is present,
//! everything that it names is present too. A file is put again if its answer was lost. The file then has the same
//! address and the same bytes, except the page, which also shows later signatures.

mod connection;
mod parts;
mod sending;
mod status;

pub use parts::PushParts;
pub use status::PushStatus;

use super::background::{Background, Plan};
use sending::Sender;

/// The thread that sends to the server; it ends when this is dropped.
#[derive(Debug)]
pub struct PushSender {
    _background: Background,
}

impl PushSender {
    /// Starts the sender.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn start(parts: PushParts) -> std::io::Result<Self> {
        let plan = Plan {
            name: "push",
            task: "the transfer of signed records to the quality system",
            blocking_threads: 2,
            stack_bytes: None,
        };
        Ok(PushSender { _background: Background::spawn_rounds(plan, move || Sender::new(&parts))? })
    }
}
