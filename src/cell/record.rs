//! The record that a cycle leaves behind: the inputs that it ran with, the part and the requests, the findings of each
//! phase, every motion, and how it ended.
//!
//! Plain data, which the phases produce, the store stores and the report shows. Each number is stored with the limit
//! against which it was checked, so that no one has to look up the limit in a recipe that has changed since then. This
//! module decides nothing, and checks no part's name: the module that accepts a name checks it.

mod conclusion;
mod contact;
mod finding;
mod requests;

pub use conclusion::{Disposition, NO_PART, conclude, finding_dispositions, states_no_part};
pub use contact::{
    AbradedGrid, AbrasionExtent, Bounds, Contact, ContactPath, EarlierPass, FirstReached, MotionRecord,
    TouchedGrid, abraded_grids, touching_passes,
};
pub use finding::{CycleId, Finding, KeptFile, Kind, PathRemoval, Picture, name, removed, removed_bound_um};
pub use panelprep_base::verdict::{Check, Limit, LimitSource, Severity};
pub use requests::{Answer, ProofsResult, RequestAuthor, RequestRecord, RequestSource, RequestedAction};

use crate::cycle::{Path, Request};
use panelprep_base::verdict::{Judgement, Verdict};
use serde::{Deserialize, Serialize};

/// The parts of the error at the tool, mm, 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Budget {
    /// Hand-eye calibration.
    pub hand_eye_mm: Option<f64>,
    /// Localization of the panel.
    pub locate_mm: Option<f64>,
    /// Fit of the surface.
    pub fit_mm: Option<f64>,
    /// The robot and its tool.
    pub robot_mm: Option<f64>,
    /// `[limits] tool_error_mm` of the cell: stated by a person, and used while a part is not measured.
    pub stated_mm: Option<f64>,
}

impl Budget {
    /// Returns the root of the sum of squares, since the parts are independent; `None` if a part is not measured.
    pub fn total_mm(&self) -> Option<f64> {
        let parts = [self.hand_eye_mm?, self.locate_mm?, self.fit_mm?, self.robot_mm?];
        Some(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
    }

    /// Returns the budget without parts that are not finite, which count as not measured.
    pub fn without_non_finite(self) -> Budget {
        let part = |mm: Option<f64>| mm.filter(|mm| mm.is_finite());
        Budget {
            hand_eye_mm: part(self.hand_eye_mm),
            locate_mm: part(self.locate_mm),
            fit_mm: part(self.fit_mm),
            robot_mm: part(self.robot_mm),
            stated_mm: part(self.stated_mm),
        }
    }

    /// Returns this budget, in which the parts that `newer` contains replace its own.
    pub fn updated_by(self, newer: Budget) -> Budget {
        Budget {
            hand_eye_mm: newer.hand_eye_mm.or(self.hand_eye_mm),
            locate_mm: newer.locate_mm.or(self.locate_mm),
            fit_mm: newer.fit_mm.or(self.fit_mm),
            robot_mm: newer.robot_mm.or(self.robot_mm),
            stated_mm: newer.stated_mm.or(self.stated_mm),
        }
    }
}

/// Code of the reason with which a cycle ends if the areas at which the film broke may not be abraded again: the
/// part's result is final.
pub const PASSES_USED: &str = "passes_used";
/// The name of the stored text in which a start reports that the fixture holds another part than before.
pub const ANOTHER_PART_TEXT: &str = "another_part";
/// The name of the stored text in which a start reports that foam lies in the cell instead of a panel.
pub const ON_FOAM: &str = "on_foam";

/// The clock with which a cycle ran.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// The wall clock, as in every real cell.
    Wall,
    /// The simulated cell's own clock, which did not advance while nothing moved and ran as fast as the computer
    /// could.
    Simulated {
        /// The clock's reading, ms.
        at_ms: u64,
    },
}

/// The file that a cycle is recorded in.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingFile {
    /// In the store's folder for recordings, under the cycle's number.
    InStore,
    /// The file with this name.
    Named(String),
}

/// Everything that is stored of a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CycleRecord {
    /// Its number.
    pub id: CycleId,
    /// Time at which the cycle began, s since 1970.
    pub started_unix_s: i64,
    /// Time at which the cycle ended, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The version of the taught data.
    pub taught_version: String,
    /// The recipe's hash.
    pub recipe_hash: String,
    /// The cell's file and its calibrations.
    pub files: Vec<KeptFile>,
    /// The program's version.
    pub program_version: String,
    /// How the cycle ended; `None` while it runs.
    pub judgement: Option<Judgement>,
    /// The error at the tool; `None` if the cycle ended before it was known.
    pub budget: Option<Budget>,
    /// Findings of the phases, in order.
    pub findings: Vec<Finding>,
    /// Every motion, in order.
    pub motions: Vec<MotionRecord>,
    /// The requests after the end of the previous cycle and before the start of this one, in order.
    pub asked_before: Vec<RequestRecord>,
    /// The requests to the cell in this cycle, in order.
    pub asked: Vec<RequestRecord>,
    /// The clock's readings at the start of the cycle and at its conclusion, if they were stored.
    pub clocks: [Option<Clock>; 2],
    /// The file in which the cycle is recorded.
    pub recording: Option<RecordingFile>,
    /// Lines of the journal that belong to the cycle.
    pub events: u64,
}

impl CycleRecord {
    /// Returns what contradicts the verdict `pass` or `accept` of this record, as text: findings, and for `pass` a
    /// missing film. The list is empty for other verdicts.
    pub fn verdict_contradictions(&self) -> Vec<String> {
        let Some(verdict) = self.judgement.as_ref().map(|judgement| judgement.verdict) else { return Vec::new() };
        // The verdict of a run in the air refers only to the motions.
        let needs_film = verdict == Verdict::Pass && !self.is_air_run();
        let no_film = conclusion::missing_film(&self.findings).filter(|_| needs_film).map(|missing| {
            format!(
                "cycle {} has the verdict pass, but {missing}; do not release the part, and inspect it again",
                self.id
            )
        });
        let contradicting = conclusion::contradicting_findings(self.id, verdict, &self.findings, &self.asked);
        contradicting.into_iter().chain(no_film).collect()
    }

    /// Returns whether the cycle was requested as a run in the air, or moved as one. Its verdict is then about the
    /// motions, not about the panel.
    pub fn is_air_run(&self) -> bool {
        let asked = |asked: &RequestRecord| {
            matches!(asked.wanted, RequestedAction::For(Request::AirRun { .. }))
                && asked.answer == Some(Answer::Done)
        };
        self.asked.iter().any(asked) || self.motions.iter().any(|kept| kept.motion.path == Path::Air)
    }

    /// Returns whether the cycle found nothing, or another object than the taught panel: its verdict `reject` is then
    /// not about the part that was named.
    pub fn has_no_part(&self) -> bool {
        self.judgement.as_ref().is_some_and(|judgement| states_no_part(&judgement.reasons))
    }

    /// Returns whether the cycle examined a part: it did not run in the air or on foam, and found the part. Only such a
    /// record releases one.
    pub fn has_examined_part(&self) -> bool {
        !self.is_air_run() && !self.is_on_foam() && !self.has_no_part()
    }

    /// Returns whether one person alone may release the part: the cycle examined it, has the verdict `pass`, and nothing
    /// in the record contradicts this verdict.
    pub fn is_released_by_one(&self) -> bool {
        let has_passed = self.judgement.as_ref().is_some_and(|end| end.verdict == Verdict::Pass);
        has_passed && self.has_examined_part() && self.verdict_contradictions().is_empty()
    }

    /// Returns whether the cycle was started with the statement that foam lies in the cell instead of a panel.
    pub fn is_on_foam(&self) -> bool {
        self.files.iter().any(|file| file.name == ON_FOAM)
    }
}

/// The names of a cycle's part, as far as they are known.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartNames {
    /// The part's serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The work order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// The name of the person who operates the cell, as stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// A person's statement at a start after the store was restored from a backup: how often the part was abraded in the
/// cycles that the restored store lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostPasses {
    /// The number of passes.
    pub passes: u8,
}

impl LostPasses {
    /// Name of the stored file with this statement, among a cycle's [`files`](CycleRecord::files).
    pub const FILE: &'static str = "lost_passes";

    /// Reads the statement from the stored file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<LostPasses> {
        toml::from_str(text).ok()
    }
}

/// Describes a part in a sentence by its serial number, which is empty for a part without one.
pub fn describe_part(serial: &str) -> String {
    if serial.is_empty() { "a part without a serial number".to_owned() } else { format!("the part {serial}") }
}

impl PartNames {
    /// Name of the stored file with these names, among a cycle's [`files`](CycleRecord::files).
    pub const FILE: &'static str = "part";

    /// Reads the names from the stored file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<PartNames> {
        toml::from_str(text).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Reason;

    /// Returns a record with only this content.
    pub fn record(judgement: Judgement, findings: Vec<Finding>, asked: Vec<RequestRecord>) -> CycleRecord {
        CycleRecord {
            id: CycleId(3),
            started_unix_s: 1,
            ended_unix_s: Some(2),
            panel: "panel".to_owned(),
            taught_version: String::new(),
            recipe_hash: String::new(),
            files: vec![],
            program_version: String::new(),
            judgement: Some(judgement),
            budget: None,
            findings,
            motions: vec![],
            asked_before: vec![],
            asked,
            clocks: [None, None],
            recording: None,
            events: 0,
        }
    }

    /// One person releases a part only if the record shows a part, and a film on it with the verdict pass.
    #[test]
    fn one_person_releases_only_a_part_that_passed() {
        let judged = |verdict, codes: &[&'static str]| Judgement {
            verdict,
            reasons: codes.iter().map(|code| Reason::new(code, "as measured")).collect(),
        };
        let film = || vec![Finding::new(Kind::Inspect, 1, judged(Verdict::Pass, &[]))];
        let passed = record(judged(Verdict::Pass, &[]), film(), vec![]);
        assert!(passed.has_examined_part() && passed.is_released_by_one());
        let foam = KeptFile { name: ON_FOAM.to_owned(), hash: String::new() };
        let on_foam = CycleRecord { files: vec![foam], ..passed.clone() };
        assert!(!on_foam.has_examined_part() && !on_foam.is_released_by_one());
        let no_part = record(judged(Verdict::Reject, &[NO_PART]), vec![], vec![]);
        assert!(!no_part.has_examined_part() && !no_part.is_released_by_one());
        for (verdict, findings) in [(Verdict::Fail, film()), (Verdict::Accept, film()), (Verdict::Pass, vec![])] {
            let other = record(judged(verdict, &[]), findings, vec![]);
            assert!(other.has_examined_part() && !other.is_released_by_one(), "{verdict:?}");
        }
        let running = CycleRecord { judgement: None, ..passed };
        assert!(!running.is_released_by_one());
    }

    /// Calculated by hand: 3-4-12 is a Pythagorean box with diagonal 13; 13² + 84² = 85².
    #[test]
    fn the_budget_has_a_total_only_if_every_part_is_measured() {
        let part = |mm: f64| Some(mm);
        let mut budget = Budget {
            hand_eye_mm: part(3.0),
            locate_mm: part(4.0),
            fit_mm: part(12.0),
            robot_mm: part(84.0),
            stated_mm: part(0.5),
        };
        assert_eq!(budget.total_mm(), Some(85.0));
        let infinite = Budget { locate_mm: part(f64::INFINITY), ..budget };
        assert_eq!(infinite.without_non_finite(), Budget { locate_mm: None, ..budget });
        let renewed = budget.updated_by(Budget { locate_mm: part(0.0), ..Budget::default() });
        assert_eq!(renewed, Budget { locate_mm: part(0.0), ..budget });
        budget.fit_mm = None;
        assert_eq!(budget.total_mm(), None);
    }
}
