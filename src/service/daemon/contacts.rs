//! The record of contact paths. Before a path begins, the grids that it will touch and the wear of the disc are
//! recorded. Before the path continues, the last permitted waypoint is recorded. The executed part is recorded after
//! the robot has reported the end of the path.
//!
//! The permitted waypoints are some seconds of motion ahead of the robot's reports, which is much more than can be in
//! progress. So after a crash at any time, the record limits the part of the path that may have been executed.

use super::error::DaemonError;
use super::ports::{RecordCommand, RobotPort};
use super::running::{LoopMemory, PathProgress, SentPath};
use panelprep_cell::cycle::{Motion, Outcome, Path};
use panelprep_cell::record::ContactPath;
use panelprep_kuka::eki::CommandId;

impl LoopMemory<'_> {
    /// Records that a motion may begin. Before contact, the wear of the disc by the whole path is recorded, so that it
    /// is not lost if a crash interrupts the path.
    pub(super) fn open_intent(&mut self, motion: &Motion) -> Result<(), DaemonError> {
        if motion.path != Path::Contact {
            return Ok(self.ports.record.perform_and_forget(RecordCommand::OpenIntent(*motion))?);
        }
        self.abrasion.executed_grade = None;
        let planned = self.cycle_setup().and_then(|cycle| self.abrasion.contact(cycle, motion.plan));
        if !self.abrasion.is_air {
            let mut abrasion = std::mem::take(&mut self.abrasion);
            self.cycle_setup().into_iter().for_each(|cycle| abrasion.note_contact_start(cycle, motion.plan));
            self.abrasion = abrasion;
        }
        // If the plan is not known, no waypoint is permitted.
        let (grids, reached_s, wears_mm2) = planned.unwrap_or_default();
        self.path_progress = PathProgress::new(reached_s, self.cell.limits.window_s());
        self.path_progress.reserved_mm2 = wears_mm2;
        self.ports.record.perform_and_forget(RecordCommand::WearDisc(wears_mm2))?;
        let id = self.state.intent.map(|intent| intent.id).unwrap_or(self.state.last_id);
        let path = ContactPath { id, pass: self.state.job.pass, grids, wears_mm2 };
        let (motion, permitted) = (*motion, self.path_progress.permitted);
        Ok(self.ports.record.perform_and_forget(RecordCommand::OpenContact { motion, path, permitted })?)
    }

    /// Permits further waypoints to the robot, after the permission is recorded.
    pub(super) fn permit_more(&mut self, sent: SentPath, done: u32) -> Result<(), DaemonError> {
        let is_contact = sent.path() == Path::Contact;
        let Some(wanted) = self.path_progress.new_permission(done).filter(|_| is_contact) else { return Ok(()) };
        // The permission is recorded before it is sent: after a crash, the grids beyond the last permitted waypoint are
        // treated as untouched, and this must be true.
        self.ports.record.perform_and_forget(RecordCommand::Permit(wanted))?;
        self.path_progress.permitted = wanted;
        let last =
            (wanted < self.path_progress.waypoint_count()).then(|| CommandId(sent.first_command().0 + wanted - 1));
        if let Err(error) = self.ports.robot.permit_commands(last) {
            // The epoch has just ended, which is reported separately.
            tracing::debug!("no further waypoints are released, because the epoch has ended: {error}");
        }
        Ok(())
    }

    /// Records how a motion ended. If the robot did not report the end, the wear and the grids that were recorded
    /// before the motion remain recorded.
    pub(super) fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), DaemonError> {
        let underway = std::mem::take(&mut self.path_progress);
        // After a Clear, the robot does not report how far the arm moved. Therefore the wear and the permitted grids
        // remain recorded.
        if motion.path == Path::Contact && outcome != Outcome::Cleared {
            self.record_contact_result(motion, done, underway.reserved_mm2)?;
        }
        let motion = *motion;
        Ok(self.ports.record.perform_and_forget(RecordCommand::CloseIntent { motion, outcome, done })?)
    }

    /// Records the result of a contact path, and its wear of the disc, computed from the poses that the robot reported.
    fn record_contact_result(&mut self, motion: &Motion, done: u32, reserved_mm2: f64) -> Result<(), DaemonError> {
        let (mut abrasion, trace) = (std::mem::take(&mut self.abrasion), std::mem::take(&mut self.trace));
        let found = self.cycle_setup().map(|cycle| {
            abrasion.evaluate_executed(cycle, (self.state.job.pass, &trace), (motion.waypoints, done))
        });
        self.abrasion = abrasion;
        let Some((notes, worn_mm2)) = found else { return Ok(()) };
        self.record_notes(notes)?;
        // The measured wear replaces the wear that was recorded before the path began.
        Ok(self.ports.record.perform_and_forget(RecordCommand::WearDisc(worn_mm2 - reserved_mm2))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: with a waypoint every 0.2 s and a window of 1 s, four windows contain 20
    /// waypoints. Further waypoints are permitted when fewer than 10 are left.
    #[test]
    fn waypoints_are_permitted_some_windows_ahead() {
        let mut underway = PathProgress::new((0..=100).map(|n| 0.2 * f64::from(n)).collect(), 1.0);
        assert_eq!(underway.permitted, 20);
        assert_eq!(underway.new_permission(9), None);
        assert_eq!(underway.new_permission(11), Some(31));
        underway.permitted = 31;
        assert_eq!(underway.new_permission(95), Some(100));
        underway.permitted = 100;
        assert_eq!(underway.new_permission(99), None);
    }

    /// A minimum number of waypoints is permitted even if the motions between them take long; otherwise the arm would
    /// have to wait for the next permission.
    #[test]
    fn a_minimum_number_of_waypoints_is_permitted() {
        let underway = PathProgress::new((0..=100).map(|n| 5.0 * f64::from(n)).collect(), 1.0);
        assert_eq!(underway.permitted, 16);
        assert_eq!((underway.new_permission(7), underway.new_permission(9)), (None, Some(25)));
        assert_eq!(PathProgress::new(Vec::new(), 1.0).permitted, 0, "nothing is known of the plan");
        assert_eq!(PathProgress::new(vec![0.0, 1.0, 2.0], 1.0).permitted, 2);
    }
}
