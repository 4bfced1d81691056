//! The record of a cycle: its inputs, the part and the requests, the findings of each phase, every motion, and the
//! verdict.
//!
//! This module contains plain data: the phases produce it, the store saves it and the report displays it. Each measured
//! number is stored with the limit at that time, because the recipe may change later. The module makes no decisions and
//! does not check the names of a part: the module that accepts a name checks it.

mod conclusion;
mod contact;
mod finding;
mod requests;

pub use conclusion::{Disposition, NO_PART, conclude, finding_dispositions, states_no_part};
pub use contact::{
    AbradedGrid, AbrasionExtent, Bounds, Contact, ContactPath, EarlierPass, FirstReached, MotionRecord,
    TouchedGrid, abraded_grids, touching_passes,
};
pub use finding::{CycleId, Finding, KeptFile, Kind, PathRemoval, Picture, name, path_removals, removed_bound_um};
pub use panelprep_base::verdict::{Check, Limit, LimitSource, Severity};
pub use requests::{Answer, ProofsResult, RequestAuthor, RequestRecord, RequestSource, RequestedAction};

use crate::cycle::{Path, Request};
use panelprep_base::verdict::{Judgement, Verdict};
use serde::{Deserialize, Serialize};

/// The error budget at the tool: its components, mm, 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Budget {
    /// Error of the hand-eye calibration.
    pub hand_eye_mm: Option<f64>,
    /// Error of the panel's localization.
    pub locate_mm: Option<f64>,
    /// Error of the surface fit.
    pub fit_mm: Option<f64>,
    /// Error of the robot and its tool.
    pub robot_mm: Option<f64>,
    /// `[limits] tool_error_mm` of the cell, which a person has stated; used while a component is not measured.
    pub stated_mm: Option<f64>,
}

impl Budget {
    /// Returns the root of the sum of squares, because the components are independent; `None` if a component is not
    /// measured.
    pub fn total_mm(&self) -> Option<f64> {
        let parts = [self.hand_eye_mm?, self.locate_mm?, self.fit_mm?, self.robot_mm?];
        Some(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
    }

    /// Returns the budget without components that are not finite; they are treated as not measured.
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

    /// Returns this budget, updated by the components that `newer` contains.
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

/// Code of the reason that ends a cycle if the areas with a broken film may not be sanded again: the part's result is
/// final.
pub const PASSES_USED: &str = "passes_used";
/// Name of the stored text in which a start request states that a different part is in the fixture.
pub const ANOTHER_PART_TEXT: &str = "another_part";
/// Name of the stored text in which a start request states that foam is in the fixture instead of a panel.
pub const ON_FOAM: &str = "on_foam";

/// The clock of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// The wall clock, used in every real cell.
    Wall,
    /// The clock of the simulated cell, which runs as fast as the computer allows and stops while nothing moves.
    Simulated {
        /// Time of the simulated clock, ms.
        at_ms: u64,
    },
}

/// The file with the recording of a cycle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingFile {
    /// The file in the store's folder for recordings that has the cycle's number.
    InStore,
    /// The file with this name.
    Named(String),
}

/// All data that are stored about a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CycleRecord {
    /// Number of the cycle.
    pub id: CycleId,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End time of the cycle, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// Name of the panel.
    pub panel: String,
    /// The version of the taught data.
    pub taught_version: String,
    /// SHA-256 of the recipe's text.
    pub recipe_hash: String,
    /// The cell's file and its calibrations.
    pub files: Vec<KeptFile>,
    /// The version of the program.
    pub program_version: String,
    /// Verdict of the cycle with its reasons; `None` while it runs.
    pub judgement: Option<Judgement>,
    /// The error budget at the tool; `None` if the cycle ended before it was known.
    pub budget: Option<Budget>,
    /// The findings of all phases, in order.
    pub findings: Vec<Finding>,
    /// All motions, in order.
    pub motions: Vec<MotionRecord>,
    /// The requests between the end of the previous cycle and the start of this one, in order.
    pub asked_before: Vec<RequestRecord>,
    /// The requests during this cycle, in order.
    pub asked: Vec<RequestRecord>,
    /// The clock at the start of the cycle and at its end, if they were stored.
    pub clocks: [Option<Clock>; 2],
    /// The file with the recording of the cycle, if it was recorded.
    pub recording: Option<RecordingFile>,
    /// Number of journal lines that belong to the cycle.
    pub events: u64,
}

impl CycleRecord {
    /// Returns the contradictions to a verdict `pass` or `accept` of this record, as texts: findings and, for `pass`, a
    /// missing film. Empty for any other verdict.
    pub fn verdict_contradictions(&self) -> Vec<String> {
        let Some(verdict) = self.judgement.as_ref().map(|judgement| judgement.verdict) else { return Vec::new() };
        // The verdict of an air-run refers only to the motions.
        let needs_film = verdict == Verdict::Pass && !self.is_air_run();
        let no_film = conclusion::missing_film(&self.findings).filter(|_| needs_film).map(|missing| {
            format!(
                "cycle {} has the verdict pass, but {missing}: do not release the part, and inspect the part again",
                self.id
            )
        });
        let contradicting = conclusion::contradicting_findings(self.id, verdict, &self.findings, &self.asked);
        contradicting.into_iter().chain(no_film).collect()
    }

    /// Returns whether the cycle was requested or executed as an air-run. Its verdict refers to the motions, not to the
    /// panel.
    pub fn is_air_run(&self) -> bool {
        let asked = |asked: &RequestRecord| {
            matches!(asked.wanted, RequestedAction::For(Request::AirRun { .. }))
                && asked.answer == Some(Answer::Done)
        };
        self.asked.iter().any(asked) || self.motions.iter().any(|kept| kept.motion.path == Path::Air)
    }

    /// Returns whether the cycle found no object, or an object other than the taught panel. Its verdict `reject` does
    /// then not refer to the part that was named.
    pub fn has_no_part(&self) -> bool {
        self.judgement.as_ref().is_some_and(|judgement| states_no_part(&judgement.reasons))
    }

    /// Returns whether the cycle examined a part: it was no air-run, not on foam, and found the part. Only such a
    /// record can release a part.
    pub fn has_examined_part(&self) -> bool {
        !self.is_air_run() && !self.is_on_foam() && !self.has_no_part()
    }

    /// Returns whether one person alone may release the part: the cycle examined the part, its verdict is `pass`, and
    /// nothing in the record contradicts the verdict.
    pub fn is_released_by_one(&self) -> bool {
        let has_passed = self.judgement.as_ref().is_some_and(|end| end.verdict == Verdict::Pass);
        has_passed && self.has_examined_part() && self.verdict_contradictions().is_empty()
    }

    /// Returns whether the start request stated that foam is in the fixture instead of a panel.
    pub fn is_on_foam(&self) -> bool {
        self.files.iter().any(|file| file.name == ON_FOAM)
    }
}

/// The names that identify the part of a cycle, and the operator; each may be unknown.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartNames {
    /// The part's serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The work order of the part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// The operator's name, as stated in the start request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// A person's statement in a start request, after the store was restored from a backup: the number of sanding passes on
/// this part in the cycles that are missing in the restored store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostPasses {
    /// Number of sanding passes.
    pub passes: u8,
}

impl LostPasses {
    /// Name of the statement's file among the [`files`](CycleRecord::files) of a cycle.
    pub const FILE: &'static str = "lost_passes";

    /// Parses the statement from its file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<LostPasses> {
        toml::from_str(text).ok()
    }
}

/// Returns how a sentence names a part: by its serial number, which is empty for a part without one.
pub fn describe_part(serial: &str) -> String {
    if serial.is_empty() { "a part without a serial number".to_owned() } else { format!("the part {serial}") }
}

impl PartNames {
    /// Name of this file among the [`files`](CycleRecord::files) of a cycle.
    pub const FILE: &'static str = "part";

    /// Parses the names from their file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<PartNames> {
        toml::from_str(text).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Reason;

    /// Returns a record with this verdict, these findings and these requests; all other data are empty.
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

    /// One person alone may release a part only if the record shows that a part was examined and that its film passed.
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

    /// Expected values, calculated by hand: a box of 3 × 4 × 12 has the diagonal 13, and 13² + 84² = 85².
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
