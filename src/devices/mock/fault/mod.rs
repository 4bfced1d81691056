//! The faults of a controller or of the link to it, and their times, so that users can test their own cell against
//! them.
//!
//! A [`FaultSpec`] is written as text (`mock-robot --fault`), see [`FaultSpec::HELP`]; [`Controller::apply_fault`] makes
//! one fault happen now. Times are the controller's own: in lock step they pass only with the client's heartbeats.
//!
//! [`Controller::apply_fault`]: super::Controller::inject

mod inject;
mod plan;
mod spec;
mod troubles;

pub use plan::{ConnectionSide, Fault, FaultSpec, FaultTime, PlannedFault};
pub use spec::FaultSpecError;

pub(super) use troubles::FaultState;
