//! A classic EthernetKRL file: what one channel of the controller is. The only reader of such files in the product; the
//! mock controller has one of its own on purpose.
//!
//! One file describes one channel: who listens and where, how much is buffered, and which tags travel. `RECEIVE`
//! and `SEND` are seen from the controller. `TYPE` names the other machine: `Client` means that the controller
//! listens.
//!
//! `tree` makes a tree of the text, `manual` compares it with the manual and notes every problem with its line, `stated`
//! is what the file states, each value with its line, and `file` is the channel that the client speaks. `panelprep
//! check` uses what is stated and all notes; the client refuses a file with a problem, and a RAW channel.

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
pub(crate) use findings::Findings;
pub use kinds::{Environment, Kind, Peer, Protocol, ReadOrder};
pub(crate) use reading::read;
pub(crate) use stated::{Signal, Stated, StatedChannel, StatedElement, StatedRaw};
