//! A mock of the robot's controller: a Rust model of the cell's KRL programs, behind EthernetKRL.
//!
//! The mock reads the controller's own files (`config/kuka/`) and shares nothing else with the client: framer, codec,
//! units and kinematics are its own.
//!
//! - bytes: `framer` (stream to documents), `channel_file` and `codec` (documents to values and back), `memory`
//!   (waiting values), `wire` (meaning of the numbers)
//! - the arm: `kinematics`, `ramp`, `corner`, `legs` and `lookahead` (speed and shape of a path), `moves` (planned
//!   moves), `mover` (the main run)
//! - the programs: `model` (one tick), `channels` and `channel_link` (connected clients), `submit` (intake, watchdog,
//!   stop), `epoch`, `program` (advance run), `contact` (retract), `outputs` (automatic switch-off), `answer` and
//!   `controller_messages` (messages sent)
//! - instead of these, the programs themselves: `interpreted` executes the shipped files
//! - around the controller: `setup`, `options`, `safety` and `operator` (people, keys, the program's start), `world`
//!   (inputs and outputs), `fault` (the faults and their times), `log` and `view` (past events, present state),
//!   `server` (TCP) with `slow_connection` (slow connections)
//!
//! As in the programs, a `move_j` stops exactly: approximated PTP is refused. Not modelled: RAW channels and UDP,
//! which a cell's files may have but this link does not use; error 23, since the programs open a channel in one place.

mod answer;
mod channel_file;
mod channel_link;
mod channels;
mod codec;
mod contact;
mod controller_messages;
mod corner;
mod epoch;
mod error;
mod fault;
mod framer;
mod interpreted;
mod kinematics;
mod legs;
mod log;
mod lookahead;
mod memory;
mod model;
mod mover;
mod moves;
mod operator;
mod options;
mod outputs;
mod program;
mod ramp;
mod safety;
mod server;
mod setup;
mod slow_connection;
mod submit;
mod view;
mod wire;
mod world;

#[cfg(test)]
mod tests;

pub use channel_file::ChannelFile;
pub use error::{EkiError, EkiFault, FileProblem, MockError};
pub use fault::{ConnectionSide, Fault, FaultSpec, FaultSpecError, FaultTime, PlannedFault};
pub use interpreted::{Programs, RobotState};
pub use kinematics::{Arm, Unreachable};
pub use log::{ContactSample, ExecutedMotion, ProgramStop, StopCause};
pub use model::Controller;
pub use options::{Clock, Mode, Rule};
pub use server::{MockHandle, MockServer, Ports};
pub use setup::Setup;
pub use wire::{Channel, Refusal};
pub use world::{UnconnectedWorld, World};
