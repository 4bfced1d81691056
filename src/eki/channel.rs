//! A classic EthernetKRL file: what one channel of the controller is.
//!
//! One file describes one channel: who listens and where, how much is buffered, and which tags travel. `RECEIVE`
//! and `SEND` are seen from the controller. `TYPE` names the other machine: `Client` means that the controller
//! listens. Names are taken in any case, as the manual itself mixes them; what no manual names is kept in
//! [`ChannelFile::unknown`] for whoever checks the file. RAW channels are not read.

mod read;

#[cfg(test)]
mod tests;

/// Who the other machine is, as the controller sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Peer {
    /// The other machine dials; the controller listens.
    Client,
    /// The other machine listens; the controller dials.
    Server,
}

/// What ends the channel on the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Environment {
    /// Resetting or deselecting the program.
    Program,
    /// Cancelling the submit interpreter.
    Submit,
    /// Only a new I/O configuration.
    System,
}

/// Which entry of a memory is read first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// The oldest.
    Fifo,
    /// The newest.
    Lifo,
}

/// What carries the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// A stream.
    Tcp,
    /// Datagrams, which the manual does not recommend.
    Udp,
}

/// What a tag's memory holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 32 bits with a sign.
    Int,
    /// A single-precision number, written `%f`.
    Real,
    /// 0 or 1.
    Bool,
    /// Characters.
    Text,
    /// Six attributes X Y Z A B C.
    Frame,
}

impl Kind {
    /// The word in the file.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Int => "INT",
            Kind::Real => "REAL",
            Kind::Bool => "BOOL",
            Kind::Text => "STRING",
            Kind::Frame => "FRAME",
        }
    }
}

/// The memories of a channel, one for each tag with a type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Which entry is read first, where a tag does not say otherwise.
    pub order: Order,
    /// Entries of each memory; one more closes the connection.
    pub entries: u32,
    /// Bytes received and not yet interpreted.
    pub bytes: u32,
}

/// One tag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// Its path without a leading slash, `Cmd/@Id`.
    pub tag: String,
    /// What its memory holds; `None` where the tag only raises a flag.
    pub kind: Option<Kind>,
    /// Which entry is read first, where it differs from the channel's.
    pub order: Option<Order>,
    /// `$FLAG` that is set when it has arrived.
    pub set_flag: Option<u32>,
    /// `$OUT` that is set when it has arrived.
    pub set_out: Option<u32>,
    /// Where it stands in the file, from 1.
    pub line: usize,
}

/// A name that is in no manual, with its line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unknown {
    /// Where it stands in the file, from 1.
    pub line: usize,
    /// The element with its parents, or the attribute with its element.
    pub name: String,
}

/// One EthernetKRL file, read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelFile {
    /// Who the other machine is.
    pub peer: Peer,
    /// Address that is listened on: the controller's, or the other machine's where the controller dials. Any
    /// text: placeholders are common.
    pub address: Option<String>,
    /// Port that is listened on.
    pub port: u16,
    /// What ends the channel.
    pub environment: Environment,
    /// What carries the bytes.
    pub protocol: Protocol,
    /// The memories.
    pub memory: Memory,
    /// How long the controller dials, or waits to be dialled, ms.
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
    /// What was not understood.
    pub unknown: Vec<Unknown>,
}

/// Why a file is not a channel. Each names its line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChannelError {
    /// Not well-formed XML.
    #[error("line {line}: not XML: {problem}")]
    NotXml {
        /// Line, from 1.
        line: usize,
        /// What the parser says.
        problem: String,
    },
    /// Some other XML.
    #[error("line {line}: the outermost element is {found}, an EthernetKRL file has ETHERNETKRL")]
    NotEthernetKrl {
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// Bytes instead of tags.
    #[error("line {line}: RAW channels carry bytes; this program speaks XML channels only")]
    Raw {
        /// Line, from 1.
        line: usize,
    },
    /// A word that is not allowed here.
    #[error("line {line}: {name} is \"{found}\", allowed are {allowed}")]
    Word {
        /// Line, from 1.
        line: usize,
        /// Element or attribute.
        name: String,
        /// What stands there.
        found: String,
        /// What may.
        allowed: &'static str,
    },
    /// A number that is not one, or outside its range.
    #[error("line {line}: {name} is \"{found}\", allowed are whole numbers {low} to {high}")]
    Number {
        /// Line, from 1.
        line: usize,
        /// Element or attribute.
        name: String,
        /// What stands there.
        found: String,
        /// Smallest allowed.
        low: u32,
        /// Largest allowed.
        high: u32,
    },
    /// An `ELEMENT` without a tag.
    #[error("line {line}: an ELEMENT without Tag carries nothing")]
    NoTag {
        /// Line, from 1.
        line: usize,
    },
    /// A tag that is no path.
    #[error("line {line}: Tag \"{found}\" is no path such as Root/Child or Root/Child/@Attribute")]
    Path {
        /// Line, from 1.
        line: usize,
        /// The tag.
        found: String,
    },
    /// An attribute twice in one element.
    #[error("line {line}: {name} stands twice")]
    Twice {
        /// Line, from 1.
        line: usize,
        /// The attribute.
        name: String,
    },
}
