//! One channel: its connection, its received values, its outgoing bytes.

use super::channel_file::{ChannelFile, Environment};
use super::error::EkiFault;
use super::memory::{Memory, Raised};

/// One channel: the received values and the bytes to send.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) memory: Memory,
    pub(super) out: Vec<u8>,
    pub(super) connected: bool,
    pub(super) fault: Option<EkiFault>,
    /// The time at which the program opens the channel again.
    pub(super) listens_at_ms: u64,
    pub(super) environment: Environment,
    pub(super) listens_for_ms: Option<u64>,
    /// The $FLAG and $OUT that are true while a client is connected.
    pub(super) alive: (Option<u16>, Option<u16>),
    /// Flags and outputs that the channel's elements set.
    pub(super) raises: Vec<Raised>,
}

impl Link {
    pub(super) fn new(memory: Memory, file: &ChannelFile) -> Self {
        let flags = file.received.iter().filter_map(|element| element.set_flag.map(Raised::Flag));
        let outputs = file.received.iter().filter_map(|element| element.set_out.map(Raised::Output));
        Link {
            memory,
            out: Vec::new(),
            connected: false,
            fault: None,
            listens_at_ms: 0,
            environment: file.environment,
            listens_for_ms: file.listens_for_ms,
            alive: file.alive,
            raises: flags.chain(outputs).collect(),
        }
    }
}
