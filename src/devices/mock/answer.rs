//! The documents that the controller sent last.

use super::codec::Template;
use super::setup::Setup;

/// The tags that the programs set, in the order in which they set them.
const ACK_TAGS: [&str; 6] = ["Ack/@Rx", "Ack/@Done", "Ack/@Free", "Ack/@Err", "Ack/@ErrId", "Ack/@Ep"];
#[rustfmt::skip] // a row for each element
const STATE_TAGS: [&str; 37] = [
    "St/@T", "St/@Seq", "St/@Re", "St/@Ep", "St/@Boot", "St/@Sum",
    "St/@Mode", "St/@Flags", "St/@In", "St/@Out", "St/@Done", "St/@Under", "St/@Ov",
    "St/J/@A1", "St/J/@A2", "St/J/@A3", "St/J/@A4", "St/J/@A5", "St/J/@A6",
    "St/Tcp/@X", "St/Tcp/@Y", "St/Tcp/@Z", "St/Tcp/@A", "St/Tcp/@B", "St/Tcp/@C",
    "St/Base/@X", "St/Base/@Y", "St/Base/@Z", "St/Base/@A", "St/Base/@B", "St/Base/@C",
    "St/Tool/@X", "St/Tool/@Y", "St/Tool/@Z", "St/Tool/@A", "St/Tool/@B", "St/Tool/@C",
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ack {
    pub(super) received: i32,
    pub(super) done: i32,
    pub(super) free: i32,
    pub(super) refusal: (i32, i32),
    pub(super) epoch: i32,
}

/// The documents that were sent last.
#[derive(Debug)]
pub(super) struct LastAnswers {
    pub(super) ack: Template,
    pub(super) state: Template,
    pub(super) last_ack: Option<(Ack, u64)>,
    pub(super) last_state_ms: u64,
    pub(super) sequence: i32,
    pub(super) answered: i32,
}

impl LastAnswers {
    pub(super) fn new(setup: &Setup) -> Self {
        LastAnswers {
            ack: Template::new(&setup.commands.sent, &ACK_TAGS),
            state: Template::new(&setup.states.sent, &STATE_TAGS),
            last_ack: None,
            last_state_ms: 0,
            sequence: setup.first_state,
            answered: 0,
        }
    }

    /// Forgets the last acknowledgement: nothing has been sent to a new client.
    pub(super) fn forget_ack(&mut self) {
        self.last_ack = None;
    }
}
