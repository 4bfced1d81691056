//! One channel of the controller: the file's statements, and the manual's defaults for everything that it does not
//! state.

use super::kinds::{Environment, Kind, PeerRole, Protocol, ReadOrder};
use super::stated::{StatedChannel, StatedElement};
use panelprep_base::config::Problem;

/// The values that apply if a file does not state them (`eki.md` 1.3).
const DEFAULT_ENTRIES: u32 = 16;
const DEFAULT_BYTES: u32 = 16_384;
const DEFAULT_PORT: u16 = 54_600;

/// The memories of a channel, one for each tag with a type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Which entry is read first, unless a tag states otherwise.
    pub order: ReadOrder,
    /// Number of entries of each memory; one more entry closes the connection.
    pub entries: u32,
    /// Largest number of bytes that are received and not yet interpreted.
    pub bytes: u32,
}

/// One tag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// The tag's path without a leading slash, `Cmd/@Id`.
    pub tag: String,
    /// The type in its memory; `None` if the tag only sets a flag.
    pub kind: Option<Kind>,
    /// Read order of the tag, if it differs from the channel's order.
    pub order: Option<ReadOrder>,
    /// `$FLAG` that is set when the element has arrived.
    pub set_flag: Option<u32>,
    /// `$OUT` that is set when the element has arrived.
    pub set_out: Option<u32>,
    /// The line of the element in the file, from 1.
    pub line: usize,
}

/// An EthernetKRL file that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelFile {
    /// The role of the other machine.
    pub peer: PeerRole,
    /// The address of the machine that listens: the controller's, or the other machine's if the controller connects.
    /// Any text is allowed: placeholders are common.
    pub address: Option<String>,
    /// Port on which the server listens.
    pub port: u16,
    /// The event that ends the channel.
    pub environment: Environment,
    /// The protocol that transfers the bytes.
    pub protocol: Protocol,
    /// The memories.
    pub memory: Memory,
    /// How long the controller tries to connect, or waits for a connection, ms.
    pub connect_timeout_ms: Option<u32>,
    /// `$FLAG` that is true while connected.
    pub alive_flag: Option<u32>,
    /// `$OUT` that is true while connected.
    pub alive_out: Option<u32>,
    /// `Ping` of `ALIVE`, as written.
    pub ping: Option<u32>,
    /// Tags that the controller receives, in the file's order.
    pub received: Vec<Element>,
    /// Tags that the controller sends, in the file's order.
    pub sent: Vec<Element>,
    /// Names and texts that are in no manual, in the file's order.
    pub unknown: Vec<Problem>,
}

/// The reason why the client cannot use a file as a channel. Each reason names its line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChannelError {
    /// The file has errors: the first one.
    #[error("line {}: {}{}{}", .0.line, .0.key, if .0.key.is_empty() { "" } else { ": " }, .0.message)]
    Wrong(Problem),
    /// The file transfers bytes instead of tags.
    #[error("line {line}: found a RAW channel, which transfers bytes; this program supports only XML channels")]
    Raw {
        /// Line, from 1.
        line: usize,
    },
}

impl ChannelFile {
    /// Reads the text of a classic EthernetKRL file.
    ///
    /// # Errors
    /// The first entry in the file that the controller would refuse or this program cannot use.
    pub fn parse(text: &str) -> Result<Self, ChannelError> {
        let (stated, found) = super::reading::read("", text).map_err(ChannelError::Wrong)?;
        if let Some(first) = found.problems.into_iter().min_by_key(|problem| problem.line) {
            return Err(ChannelError::Wrong(first));
        }
        match stated.raw_line {
            Some(line) => Err(ChannelError::Raw { line }),
            None => Ok(ChannelFile::from_stated(&stated, found.unknown)),
        }
    }

    fn from_stated(stated: &StatedChannel, unknown: Vec<Problem>) -> Self {
        let server = stated.server();
        let signal =
            |is_flag| stated.alive.iter().find(|signal| signal.is_flag == is_flag).map(|signal| signal.number);
        ChannelFile {
            peer: stated.peer_role(),
            address: server.ip.as_ref().map(|ip| ip.value.clone()),
            port: server.port.map_or(DEFAULT_PORT, |port| port.value),
            environment: stated.environment.map_or(Environment::Program, |environment| environment.value),
            protocol: stated.protocol.map_or(Protocol::Tcp, |protocol| protocol.value),
            memory: Memory {
                order: stated.order.map_or(ReadOrder::Fifo, |order| order.value),
                entries: stated.entries.map_or(DEFAULT_ENTRIES, |entries| entries.value),
                bytes: stated.bytes.map_or(DEFAULT_BYTES, |bytes| bytes.value),
            },
            connect_timeout_ms: stated.connect_ms.map(|timeout| timeout.value),
            alive_flag: signal(true),
            alive_out: signal(false),
            ping: stated.ping.map(|ping| ping.value),
            received: stated.received.iter().map(Element::from_stated).collect(),
            sent: stated.sent.iter().map(Element::from_stated).collect(),
            unknown,
        }
    }
}

impl Element {
    fn from_stated(stated: &StatedElement) -> Self {
        let signal =
            |is_flag| stated.signals.iter().find(|signal| signal.is_flag == is_flag).map(|signal| signal.number);
        Element {
            tag: stated.tag.clone(),
            kind: stated.kind.as_ref().and_then(|kind| kind.parse().ok()),
            order: stated.order,
            set_flag: signal(true),
            set_out: signal(false),
            line: stated.line,
        }
    }
}
