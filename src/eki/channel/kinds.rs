//! The words that an EthernetKRL file may hold. They are read in any case, as the manual itself mixes them.

use strum::{Display, EnumString, VariantNames};

/// Who the other machine is, as the controller sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive)]
pub enum Peer {
    /// The other machine dials; the controller listens.
    Client,
    /// The other machine listens; the controller dials.
    Server,
}

/// What ends the channel on the controller.
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
    /// The oldest.
    Fifo,
    /// The newest.
    Lifo,
}

/// What carries the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Protocol {
    /// A stream.
    Tcp,
    /// Datagrams, which the manual does not recommend.
    Udp,
}

/// What a tag's memory holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Kind {
    /// Characters.
    #[strum(serialize = "STRING")]
    Text,
    /// A single-precision number, written `%f`.
    Real,
    /// 32 bits with a sign.
    Int,
    /// 0 or 1.
    Bool,
    /// Six attributes X Y Z A B C.
    Frame,
}
