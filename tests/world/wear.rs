//! Compares the record of contact with the messages that this process sent to the record, and with the arm's motions:
//! the wear of the disc, which is recorded before a path begins and corrected at its end, and the executed waypoints.

use panelprep::cycle::{Event, Outcome, Path, Report};
use panelprep::daemon::{RecordAnswer, RecordCommand};

/// Factor by which an interrupted path, or a path whose ends are rotated, may sweep more area than planned.
const MAX_SWEEP_FACTOR: f64 = 1.2;
const EXACT_MM2: f64 = 0.01;

/// The messages of this process to the record.
#[derive(Debug, Default)]
pub struct Wear {
    /// The area that the disc has swept, mm², after the record has stated it.
    worn_mm2: Option<f64>,
    /// The swept area before the present contact path, mm²; `path_mm2` is the area that was recorded for the path.
    before_mm2: Option<f64>,
    path_mm2: f64,
    /// Number of waypoints of the present contact path that were reported as executed.
    told: u32,
}

impl Wear {
    /// Records that the record has acknowledged the command. Returns the error in the record's answer, given the number
    /// of motions that the arm has executed since the path was opened. If the positions that the controller reported
    /// may have been wrong, the record may count more wear for a path than there was, but never less.
    pub fn acknowledged(
        &mut self,
        command: &RecordCommand,
        answer: &RecordAnswer,
        (executed, may_be_lied_to): (Option<usize>, bool),
    ) -> Option<String> {
        match (command, answer) {
            (RecordCommand::DiscWorn, RecordAnswer::Worn(worn_mm2)) => {
                let known_mm2 = *self.worn_mm2.get_or_insert(*worn_mm2);
                self.before_mm2.get_or_insert(*worn_mm2);
                let off = (known_mm2 - worn_mm2).abs() > EXACT_MM2;
                off.then(|| format!("the disc has swept {worn_mm2} mm² by the record, {known_mm2} mm² were told"))
            }
            (RecordCommand::WearDisc(mm2), _) => {
                self.worn_mm2 = self.worn_mm2.map(|worn_mm2| worn_mm2 + mm2);
                None
            }
            (RecordCommand::MountDisc, _) => {
                (self.worn_mm2, self.before_mm2) = (Some(0.0), Some(0.0));
                None
            }
            (RecordCommand::OpenContact { path, .. }, _) => {
                (self.path_mm2, self.told) = (path.wears_mm2, 0);
                let counted_mm2 = self.worn_mm2? - self.before_mm2?;
                let is_less = counted_mm2 < path.wears_mm2 - EXACT_MM2;
                let wears_mm2 = path.wears_mm2;
                is_less.then(|| format!("a path that wears {wears_mm2} mm² begins, counted are {counted_mm2} mm²"))
            }
            (RecordCommand::Event(Event::Reported(Report::Progress { done, .. })), _) => {
                self.told = self.told.max(*done);
                None
            }
            (RecordCommand::CloseIntent { motion, outcome, done }, _) => {
                let told = std::mem::take(&mut self.told);
                let before_mm2 = std::mem::replace(&mut self.before_mm2, self.worn_mm2);
                if motion.path != Path::Contact || *outcome == Outcome::Cleared {
                    return None;
                }
                if *done < told {
                    return Some(format!("{told} waypoints were told, the motion is closed with {done}"));
                }
                if executed.is_some_and(|executed| *done as usize > executed) {
                    return Some(format!("{done} waypoints are on the record, {executed:?} were executed"));
                }
                let counted_mm2 = self.worn_mm2? - before_mm2?;
                let most_mm2 =
                    if may_be_lied_to { f64::INFINITY } else { MAX_SWEEP_FACTOR * self.path_mm2 + EXACT_MM2 };
                let is_wrong = !(-EXACT_MM2..=most_mm2).contains(&counted_mm2);
                is_wrong.then(|| format!("a path of {} mm² is counted as {counted_mm2} mm²", self.path_mm2))
            }
            _ => None,
        }
    }
}
