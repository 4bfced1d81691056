//! The client's half of the robot protocol EthernetKRL (EKI), without sockets.
//!
//! A session receives bytes and commands, and returns bytes and reports. The caller passes the time as `now`, so a
//! session runs on the wall clock or in virtual time. There are two channels: the command channel with commands and
//! acknowledgements, and the state channel with the controller's state, heartbeats and aborts, which no motion can
//! delay. The tags and their order are defined by the controller's own EthernetKRL files, `config/kuka/`.
//!
//! Read in this order: [`channel`](ChannelFile) (the content of a file) · [`command`](Command) (the robot's commands) ·
//! [`framer`](Framer) and [`wire`](Wire) (bytes to documents to values) · [`session`](Session) (epochs, ids, credits,
//! the watchdog).
//!
//! This module opens no sockets and reads no clock; `devices::robot` does both.

pub mod channel;
mod command;
mod framer;
mod ids;
mod report;
mod schema;
mod session;
mod state;
mod wire;

pub use channel::{ChannelError, ChannelFile, Element, Environment, Kind, Memory, PeerRole, Protocol, ReadOrder};
pub use command::{
    Command, CommandError, MappedInputs, MoveJ, MoveLin, Request, SetAccSpeed, SetTcp, Signal, TcpKind,
};
pub use framer::{FrameError, Framer, MAX_DOCUMENT_BYTES};
pub use ids::{CommandId, Epoch, MAX_EPOCH_STEP, Time};
pub use report::{Channel, EchoMismatch, LinkLoss, Report, SequenceError, StopCause};
pub use schema::{DecodeError, SchemaError};
pub use session::{ClockMode, LinkLimits, QueueError, Session};
pub use state::{Ack, CONTACT_OVERRIDE_PERCENT, Mode, Refusal, State};
pub use wire::Wire;

/// The command channel's configuration file as it is loaded on the controller.
pub const CELLCMD: &str = include_str!("../../../config/kuka/CELLCMD.xml");
/// The state channel's configuration file as it is loaded on the controller.
pub const CELLSTAT: &str = include_str!("../../../config/kuka/CELLSTAT.xml");

/// Documents in the form in which a controller writes them, for the tests of this module.
#[cfg(test)]
mod fixture {
    use super::{CELLCMD, CELLSTAT, ChannelFile, Wire};

    pub(super) fn wire() -> Wire {
        let [command, state] = [CELLCMD, CELLSTAT].map(|text| ChannelFile::parse(text).expect("a shipped file"));
        Wire::new(&command, &state).expect("the shipped files fit")
    }

    /// A state message of a KRC, written by hand value by value.
    pub(super) const STATE: &str = "<St T=\"1200\" Seq=\"7\" Re=\"3\" Ep=\"2\" Boot=\"77\" Sum=\"-12345\" Mode=\"4\" Flags=\"119\" \
        In=\"5\" Out=\"2\" Done=\"17\" Under=\"0\" Ov=\"100\"><J A1=\"4.999516\" A2=\"-90.000031\" A3=\"90.000000\" A4=\"0.000000\" \
        A5=\"45.500000\" A6=\"-185.250000\"></J><Tcp X=\"100.250000\" Y=\"-20.500000\" Z=\"300.125000\" A=\"90.000000\" \
        B=\"0.000000\" C=\"-179.959747\"></Tcp><Base X=\"400.000000\" Y=\"0.000000\" Z=\"12.500000\" A=\"0.500000\" \
        B=\"0.000000\" C=\"0.000000\"></Base><Tool X=\"0.000000\" Y=\"0.000000\" Z=\"120.000000\" A=\"0.000000\" \
        B=\"0.000000\" C=\"0.000000\"></Tool></St>";

    /// An acknowledgement of a KRC, written by hand.
    pub(super) const ACK: &str = "<Ack Rx=\"20\" Done=\"17\" Free=\"97\" Err=\"0\" ErrId=\"0\" Ep=\"2\"></Ack>";
}
