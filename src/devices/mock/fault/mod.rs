//! Injected faults of the mock controller or of the link to it: those that are planned, and those that are active. With
//! them, users can test their own cell.
//!
//! A [`FaultSpec`] is written as text (`mock-robot --fault`), see [`FaultSpec::HELP`]. [`Controller::apply_fault`]
//! injects one fault immediately. Times are those of the controller: in lock step they advance only with the client's
//! heartbeats.
//!
//! [`Controller::apply_fault`]: super::Controller::apply_fault

mod inject;
mod spec;

use super::wire::{Channel, Command, Refusal, SET_BASE, SET_TCP};
pub use spec::{ConnectionSide, Fault, FaultSpec, FaultSpecError, FaultTime, PlannedFault};

/// The offset of the fault `wrong-base`, mm.
const BASE_ERROR_MM: f64 = 1.0;

/// The planned and the active faults of a mock controller.
#[derive(Debug, Default)]
pub(super) struct FaultState {
    planned: Vec<PlannedFault>,
    commands_arrived: u64,
    /// The active faults with a limited duration, each with the time of its end.
    ends: Vec<(u64, Fault)>,
    unplugged: bool,
    mute: bool,
    no_acks: bool,
    stalled: bool,
    slow_share: Option<f64>,
    override_percent: Option<u8>,
    pose_deviation_mm: Option<u8>,
    /// The operation (`set_base` or `set_tcp`) whose next command is acknowledged but not executed.
    lost_operation: Option<i32>,
    wrong_base: bool,
    refusal: Option<Refusal>,
    skips_state: bool,
    /// For each channel, the bytes and the closing of the connection that are held back while the cable is unplugged.
    pub(super) cable_buffer: [Vec<u8>; 2],
    pub(super) hung_up: [bool; 2],
}

impl FaultState {
    pub(super) fn new(planned: Vec<PlannedFault>) -> Self {
        FaultState { planned, ..FaultState::default() }
    }

    /// Returns whether the cable is unplugged.
    pub(super) fn is_unplugged(&self) -> bool {
        self.unplugged
    }

    /// Returns whether a fault prevents sending on this channel.
    pub(super) fn is_channel_silenced(&self, channel: Channel) -> bool {
        self.mute || (self.no_acks && channel == Channel::Command)
    }

    /// Returns whether a fault stalls the submit interpreter.
    pub(super) fn is_submit_stalled(&self) -> bool {
        self.stalled
    }

    /// `$OV_PRO`.
    pub(super) fn override_percent(&self) -> u8 {
        self.override_percent.unwrap_or(100)
    }

    /// Returns the injected error of the measured pose along Z, mm.
    pub(super) fn pose_deviation_mm(&self) -> f64 {
        self.pose_deviation_mm.map_or(0.0, f64::from)
    }

    /// Returns the ratio of the arm's actual speed to its commanded speed.
    pub(super) fn speed_share(&self) -> f64 {
        self.slow_share.unwrap_or(1.0) * f64::from(self.override_percent()) / 100.0
    }

    /// Removes and returns the injected reason to refuse the next command, if there is one.
    pub(super) fn take_refusal(&mut self) -> Option<Refusal> {
        self.refusal.take()
    }

    /// Returns 1 if a fault skips the next sequence number of the state messages, otherwise 0.
    pub(super) fn take_sequence_skip(&mut self) -> i32 {
        i32::from(std::mem::take(&mut self.skips_state))
    }

    /// Returns the frame that a command actually sets, with the injected faults; `None` if the command has no effect.
    pub(super) fn faulty_frame(&mut self, command: &Command) -> Option<[f64; 6]> {
        let mut numbers = command.p;
        if self.lost_operation == Some(command.operation) {
            self.lost_operation = None;
            return None;
        }
        if command.operation == SET_BASE && std::mem::take(&mut self.wrong_base) {
            numbers[0] += BASE_ERROR_MM;
        }
        Some(numbers)
    }
}

impl FaultState {
    /// Returns the frame that an assignment to `$BASE` or `$TOOL` actually sets, with the injected faults; `None` if
    /// the assignment has no effect. A null frame is never affected, because the robot program itself assigns it at the
    /// start of an epoch.
    pub(super) fn apply_frame_faults(&mut self, is_base: bool, mut frame: [f32; 6]) -> Option<[f32; 6]> {
        let operation = if is_base { SET_BASE } else { SET_TCP };
        if frame == [0.0; 6] {
            return Some(frame);
        }
        if self.lost_operation == Some(operation) {
            self.lost_operation = None;
            return None;
        }
        if is_base && std::mem::take(&mut self.wrong_base) {
            frame[0] += BASE_ERROR_MM as f32;
        }
        Some(frame)
    }
}
