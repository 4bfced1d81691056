//! The controller's state as tests, cameras and servers can see it.

use super::log::{ContactSample, ExecutedMotion, ProgramStop};
use super::model::Controller;
use super::options::Clock;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
use std::collections::BTreeMap;

impl Controller {
    /// Returns the delay of the bytes, whether they are sent in fragments, and the seed of both.
    pub(super) fn wire_faults(&self) -> (Option<(u64, u64)>, bool, u64) {
        let faults = &self.setup.faults;
        (faults.delay_ms, faults.fragment, faults.seed)
    }

    /// Returns the source of the controller's time.
    pub fn clock(&self) -> Clock {
        self.setup.clock
    }

    /// Returns the time since the start, ms.
    pub fn time_ms(&self) -> u64 {
        self.now_ms
    }

    /// Returns the axis angles.
    pub fn joints(&self) -> Joints {
        self.mover.joints()
    }

    /// Returns the true flange pose.
    pub fn flange_pose(&self) -> Rigid<Base, Flange> {
        match &self.setup.real_arm {
            Some(arm) => arm.base_from_flange(&self.mover.joints()),
            None => self.mover.base_from_flange(),
        }
    }

    /// Returns whether the arm moves or has planned moves.
    pub fn is_moving(&self) -> bool {
        !self.mover.is_idle() || self.contact.is_retract_due()
    }

    /// Returns the override that a person has set, %.
    pub fn override_percent(&self) -> u8 {
        self.troubles.override_percent()
    }

    /// Returns the deviation of the reported pose along Z of the present base, mm.
    pub fn pose_deviation_mm(&self) -> f64 {
        self.troubles.pose_deviation_mm()
    }

    /// Returns every `$OUT` that was ever set.
    pub fn outputs(&self) -> &BTreeMap<u16, bool> {
        &self.outputs
    }

    /// Returns whether mode, keys, drives, guard and program let the arm move.
    pub fn can_move(&self) -> bool {
        self.safety.motion_possible()
    }

    /// Returns every `$FLAG` that was ever set.
    pub fn flags(&self) -> &BTreeMap<u16, bool> {
        &self.flags
    }

    /// Returns the last command received in the present epoch, and the last one executed.
    pub fn counts(&self) -> (i32, i32) {
        self.running
            .as_ref()
            .map_or((self.epoch.last_received, self.epoch.last_executed), |running| running.counts())
    }

    /// The present epoch.
    pub fn epoch(&self) -> i32 {
        self.running.as_ref().map_or(self.epoch.number, |running| running.epoch())
    }

    /// Returns whether the program has stopped the epoch.
    pub fn is_stopped(&self) -> bool {
        self.running.as_ref().map_or(self.stopped, |running| running.is_stopped())
    }

    /// Returns how many times the next point was missing.
    pub fn underrun_count(&self) -> i32 {
        self.running.as_ref().map_or(self.underruns, |running| running.underruns())
    }

    /// Returns how many commands of ended epochs arrived and were dropped.
    pub fn stale_commands(&self) -> u64 {
        self.stale_messages
    }

    /// Returns every motion that was executed, in order.
    pub fn executed_motions(&self) -> &[ExecutedMotion] {
        &self.executed
    }

    /// Returns the samples of the tool at each tick of every contact.
    pub fn trace(&self) -> &[ContactSample] {
        &self.trace
    }

    /// Returns every stop by the program.
    pub fn program_stops(&self) -> &[ProgramStop] {
        &self.stops
    }
}
