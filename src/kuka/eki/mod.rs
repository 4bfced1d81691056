//! The robot's protocol without sockets: the client's half of EthernetKRL (EKI).
//!
//! Bytes and commands in, bytes and reports out; `now` comes from outside, so one session runs on the wall clock or
//! in virtual time. Two channels: commands with their acknowledgements, and the controller's state with heartbeat
//! and abort, which no motion can delay. Tags and their order come from the EthernetKRL files of the controller
//! itself, `config/kuka/`.
//!
//! Read in this order: [`channel`](ChannelFile) (the content of a file) · [`command`](Command) (the robot's
//! commands) · [`framer`](Framer) and [`wire`](Wire) (bytes to documents to values) · [`session`](Session) (epochs,
//! ids, credits, the watchdog).
//!
//! Does not open sockets and reads no clock: see `devices::robot`.

mod ack;
pub mod channel;
mod command;
mod decode;
mod framer;
mod ids;
mod report;
mod schema;
mod session;
mod state;
mod time;
mod wire;
mod word;

#[cfg(test)]
mod fixture;

pub use ack::{Ack, Refusal};
pub use channel::{ChannelError, ChannelFile, Element, Environment, Kind, Memory, PeerRole, Protocol, ReadOrder};
pub use command::{
    Command, CommandError, MappedInputs, MoveJ, MoveLin, Request, SetAccSpeed, SetTcp, Signal, TcpKind,
};
pub use decode::DecodeError;
pub use framer::{FrameError, Framer, MAX_DOCUMENT_BYTES};
pub use ids::{CommandId, Epoch, MAX_EPOCH_STEP};
pub use report::{Channel, EchoMismatch, LinkLoss, Report, SequenceError, StopCause};
pub use schema::SchemaError;
pub use session::{ClockMode, LinkLimits, QueueError, Session};
pub use state::{CONTACT_OVERRIDE_PERCENT, Mode, State};
pub use time::Time;
pub use wire::Wire;

/// The command channel's configuration file as it is loaded on the controller.
pub const CELLCMD: &str = include_str!("../../../config/kuka/CELLCMD.xml");
/// The state channel's configuration file as it is loaded on the controller.
pub const CELLSTAT: &str = include_str!("../../../config/kuka/CELLSTAT.xml");
