//! A classic EthernetKRL file: the description of one channel of the controller. This is the only reader of such files
//! in the product; the mock controller intentionally has its own reader.
//!
//! One file describes one channel: which machine listens and where, how much is buffered, and which tags are sent.
//! `RECEIVE` and `SEND` are seen from the controller. `TYPE` names the other machine: `Client` means that the
//! controller listens.
//!
//! `tree` converts the text to a tree, and `manual` compares it with the manual and notes every problem with its line.
//! `stated` contains the file's statements, each value with its line, and `file` is the channel that the client uses.
//! `panelprep check` uses the statements and all notes; the client refuses a file with a problem, and a RAW channel.

mod file;
mod findings;
mod kinds;
mod manual;
mod reading;
mod stated;
#[cfg(test)]
mod tests;
mod tree;

pub use file::{ChannelError, ChannelFile, Element, Memory};
pub use findings::Findings;
pub use kinds::{Environment, Kind, PeerRole, Protocol, ReadOrder};
pub use reading::read;
pub use stated::{Signal, Stated, StatedChannel, StatedElement, StatedRaw};
