//! The primary host application: if one is named, nothing is published without it.

use serde::Deserialize;

/// A host's statement about itself on its STATE topic, as JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct HostState {
    /// Whether the host is online.
    pub online: bool,
    /// The connection to which the statement refers, identified by its time, ms since 1970.
    pub timestamp: u64,
}

impl HostState {
    /// Decodes a host's STATE message; `None` if the bytes are not one.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice(bytes).ok()
    }
}

/// The known state of the primary host. A statement that is older than an earlier received one refers to an earlier
/// connection of the host and changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PrimaryHost {
    is_online: bool,
    /// The newest time of any statement, and of an online statement.
    newest: Option<u64>,
    newest_online: Option<u64>,
}

impl PrimaryHost {
    pub fn is_online(self) -> bool {
        self.is_online
    }

    /// Begins a new connection to the broker: of earlier statements, only the time still counts.
    pub fn connected(self) -> Self {
        PrimaryHost { is_online: false, ..self }
    }

    pub fn with_state(self, state: HostState) -> Self {
        let since = if state.online { self.newest } else { self.newest_online };
        if since.is_some_and(|since| state.timestamp < since) {
            return self;
        }
        let newest_online = if state.online { Some(state.timestamp) } else { self.newest_online };
        PrimaryHost { is_online: state.online, newest: self.newest.max(Some(state.timestamp)), newest_online }
    }
}
