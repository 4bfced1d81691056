//! The keywords that an EthernetKRL file may contain. They are read in upper or lower case, as the manual itself
//! mixes both.

use strum::{Display, EnumString, VariantNames};

/// The role of the other machine, as the controller sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive)]
pub enum PeerRole {
    /// The other machine connects; the controller listens.
    Client,
    /// The other machine listens; the controller connects.
    Server,
}

/// The event that ends the channel on the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive)]
pub enum Environment {
    /// Resetting or deselecting the program.
    Program,
    /// Cancelling the submit interpreter.
    Submit,
    /// Only a new I/O configuration.
    System,
}

/// Which entry of a memory is read first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum ReadOrder {
    /// The oldest entry is read first.
    Fifo,
    /// The newest entry is read first.
    Lifo,
}

/// The protocol that transfers the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Protocol {
    /// A stream.
    Tcp,
    /// Datagrams, which the manual does not recommend.
    Udp,
}

/// The type of the values in a tag's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Kind {
    /// Characters.
    #[strum(serialize = "STRING")]
    Text,
    /// A single-precision number, written `%f`.
    Real,
    /// A signed 32-bit integer.
    Int,
    /// 0 or 1.
    Bool,
    /// Six attributes X Y Z A B C.
    Frame,
}
