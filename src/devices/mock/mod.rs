//! A mock of the robot controller: a Rust model of the cell's KRL programs, with EthernetKRL as its interface.
//!
//! The mock reads the controller's own files (`config/kuka/`) and shares nothing else with the client; it has its own
//! framer, codec, units and kinematics.
//!
//! - bytes: `framer` (stream to documents), `channel_file` and `codec` (documents to values and back), `memory`
//!   (buffers of a channel), `wire` (meaning of the values)
//! - the arm: `kinematics`, `moves` (planned motions, geometry and speed of a path), `mover` (the main run)
//! - the programs: `model` (one tick, the epoch, the contact), `channels` (connected clients, messages sent), `submit`
//!   (reception of commands, watchdog, stop), `program` (advance run), `outputs` (automatic switch-off)
//! - instead of these programs: `interpreted` executes the shipped files
//! - around the controller: `setup` (with the executed programs, and the devices on the inputs and outputs), `options`
//!   (with the safety controller), `operator` (people, keys, the program's start, the current state), `fault` (injected
//!   faults and their times), `log` (past events), `server` (TCP)
//!
//! As in the programs, a `move_j` stops exactly: an approximated PTP is refused. Not modelled: RAW channels and UDP,
//! which a cell's files may contain but this link does not use; error 23, because the programs open a channel in one
//! place only.

mod channel_file;
mod channels;
mod codec;
mod fault;
mod framer;
mod interpreted;
mod kinematics;
mod log;
mod memory;
mod model;
mod mover;
mod moves;
mod operator;
mod options;
mod outputs;
mod program;
mod server;
mod setup;
mod submit;
mod wire;

#[cfg(test)]
mod tests;

pub use channel_file::{ChannelFile, EkiError, EkiFault, FileProblem, MockError};
pub use fault::{ConnectionSide, Fault, FaultSpec, FaultSpecError, FaultTime, PlannedFault};
pub use interpreted::RobotState;
pub use kinematics::{Arm, Unreachable};
pub use log::{ContactSample, ExecutedMotion, ProgramStop, StopCause};
pub use model::Controller;
pub use options::{Clock, Mode, Rule};
pub use server::{MockHandle, MockServer, Ports};
pub use setup::{Programs, Setup, UnconnectedWorld, World};
pub use wire::{Channel, Refusal};
