//! Which controller answers now: decided by what it reports, never by its address, since a tunnel to a real controller
//! ends at an address of this computer.

use super::fault::{DeviceFault, Fault};
use super::live;
use panelprep_cell::cell::{Cell, ProofStage};
use panelprep_kuka::eki::Mode;
use panelprep_service::daemon::SingleRobot;
use std::time::Duration;

/// Time in which a controller makes its channels available again after a client has left: a path that begins sooner
/// would find them occupied.
const RELEASE_PAUSE: Duration = Duration::from_millis(500);

/// The kind of controller that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerKind {
    /// A real controller, by its boot id.
    Real,
    /// A mock controller: it proves nothing, and moves no arm.
    Mock,
    /// Nothing answers, so that the kind is not known.
    Unknown,
}

/// The controller that answers, as it reports itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportedController {
    /// The kind.
    pub kind: ControllerKind,
    /// The checksum of its programs; `None` if nothing answers.
    pub programs_sum: Option<i32>,
    /// Its operating mode; `None` if nothing answers.
    pub mode: Option<Mode>,
}

impl ReportedController {
    /// Nothing answers.
    pub const UNKNOWN: ReportedController =
        ReportedController { kind: ControllerKind::Unknown, programs_sum: None, mode: None };
}

/// Connects to the cell's controller and reads its state once. Nothing moves.
///
/// # Errors
/// If the link cannot be started.
pub fn identify(cell: &Cell) -> Result<ReportedController, Fault> {
    let (mut robot, _simulated) = live::robot_alone(cell)?;
    let Ok(single) = SingleRobot::connect(&mut robot, cell.arm()) else { return Ok(ReportedController::UNKNOWN) };
    let state = single.state();
    let kind = if state.is_simulated() { ControllerKind::Mock } else { ControllerKind::Real };
    Ok(ReportedController { kind, programs_sum: Some(state.programs_checksum), mode: Some(state.mode) })
}

/// Refuses a path that needs this stage of the proofs, before anything is read or written for it. Only a controller
/// that reports itself as a mock needs none.
///
/// # Errors
/// If the stage is not signed, or the link cannot be started.
pub fn require_signed(cell: &Cell, needed: ProofStage) -> Result<(), Fault> {
    let Err(unsigned) = cell.robot().requires_signed(needed) else { return Ok(()) };
    if identify(cell)?.kind == ControllerKind::Mock {
        std::thread::sleep(RELEASE_PAUSE);
        return Ok(());
    }
    Err(DeviceFault::from(unsigned).into())
}
