//! What can go wrong at a controller or on the way to it, and when: so that users test their own cell against it.
//!
//! A [`FaultSpec`] is written as text (`mock-robot --fault`), see [`FaultSpec::HELP`]; [`Controller::inject`] makes
//! one fault happen now. Times are the controller's own: in lock step they pass with the client's heartbeats only.
//!
//! [`Controller::inject`]: super::Controller::inject

mod inject;
mod plan;
mod spec;
mod troubles;

pub use plan::{Fault, FaultSpec, Planned, Side, When};
pub use spec::FaultSpecError;

pub(super) use troubles::Troubles;
