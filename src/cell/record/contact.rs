//! The part of a contact path that may have been executed, and the grids that it may have touched.
//!
//! Before a waypoint in contact may be sent, its permission is stored: waypoints are permitted in blocks. So after any
//! end (a crash, a lost link) the robot has executed at least the reported and at most the permitted waypoints.
//! Together with the waypoint from which on the disc reaches each grid, this limits the grids that can have been
//! touched.

use super::finding::{CycleId, Finding, Kind};
use crate::cycle::{Id, Motion, Outcome, Path};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A motion, stored before its first waypoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionRecord {
    /// The motion.
    pub motion: Motion,
    /// The end of the motion; `None` while it is open.
    pub outcome: Option<Outcome>,
    /// Number of executed waypoints that the robot reported at the motion's end; without meaning if it did not report.
    pub done: u32,
    /// For a contact path, the treated grids and the progress, as far as they were recorded.
    pub contact: Option<Contact>,
}

/// The data of a contact path: grids, pass and wear; stored with the motion, before its first waypoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContactPath {
    /// The action that moves; the robot reports its progress under this id.
    pub id: Id,
    /// Number of the pass, from 1.
    pub pass: u8,
    /// The planned grids, each with the first waypoint of the motion in which the disc reaches it.
    pub grids: Vec<FirstReached>,
    /// Wear of the disc by the whole path, mm²; added before the path begins.
    pub wears_mm2: f64,
}

/// The first waypoint at which a grid is touched.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FirstReached {
    /// The grid.
    pub grid: String,
    /// The number of the first waypoint on the grid, counted as [`Motion::waypoints`](crate::cycle::Motion::waypoints)
    /// counts, from 1.
    pub first: u32,
}

/// A contact path, the robot's reports and the permitted waypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The path.
    pub path: ContactPath,
    /// Number of executed waypoints, as far as the robot reported.
    pub told: u32,
    /// Number of waypoints that were permitted to be sent.
    pub permitted: u32,
}

/// Lower and upper bound of a number of waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bounds {
    /// The number that was certainly executed.
    pub at_least: u32,
    /// The largest number that can have been executed.
    pub at_most: u32,
}

/// A grid that the tool touched or may have touched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TouchedGrid {
    /// The grid.
    pub grid: String,
    /// Whether a waypoint on the grid was certainly executed.
    pub is_sure: bool,
}

impl MotionRecord {
    /// Returns whether the robot reported how the motion ended. It did not report this if the motion is open, or if a
    /// person cleared the motion.
    pub fn is_end_reported(&self) -> bool {
        self.outcome.is_some_and(|outcome| outcome != Outcome::Cleared)
    }

    /// Returns the bounds of the number of executed waypoints; `None` if nothing was stored that limits it.
    pub fn executed_bounds(&self) -> Option<Bounds> {
        if self.is_end_reported() {
            return Some(Bounds { at_least: self.done, at_most: self.done });
        }
        let contact = self.contact.as_ref()?;
        Some(Bounds { at_least: contact.told, at_most: contact.permitted.max(contact.told) })
    }

    /// Returns the grids that were touched, or may have been; `None` if this was not stored. The list is empty for
    /// other motions.
    pub fn touched_grids(&self) -> Option<Vec<TouchedGrid>> {
        if self.motion.path != Path::Contact {
            return Some(Vec::new());
        }
        let (contact, executed) = (self.contact.as_ref()?, self.executed_bounds()?);
        // If the robot reported the motion's end, the tool may have been on its way to the next waypoint.
        let begun = executed.at_most + u32::from(self.is_end_reported());
        let grids = contact.path.grids.iter().filter(|reached| reached.first <= begun);
        let touched = |reached: &FirstReached| TouchedGrid {
            grid: reached.grid.clone(),
            is_sure: reached.first <= executed.at_least,
        };
        Some(grids.map(touched).collect())
    }
}

/// The effect of the tool on a grid in a pass.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AbradedGrid {
    /// The grid; `None` means any grid, because the grids were not stored.
    pub grid: Option<String>,
    /// The pass.
    pub pass: u8,
    /// The extent of the abrasion.
    pub how: AbrasionExtent,
}

/// The extent to which a grid was abraded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AbrasionExtent {
    /// The grid was abraded as planned.
    Whole,
    /// The grid was abraded in part, according to the poses that the robot reported.
    InPart,
    /// The grid was touched; the touched part is not known.
    Touched,
    /// The grid may have been touched.
    PossiblyTouched,
}

impl AbrasionExtent {
    /// Returns whether the tool was certainly on the grid.
    pub fn is_certain(self) -> bool {
        self != AbrasionExtent::PossiblyTouched
    }
}

/// A certain or possible contact of the tool with a grid in an earlier cycle of the same panel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EarlierPass {
    /// The cycle.
    pub cycle: CycleId,
    /// Number of the pass.
    pub pass: u8,
    /// The grid; `None` means any grid.
    pub grid: Option<String>,
    /// Whether the grid was certainly touched.
    pub is_sure: bool,
    /// Whether a person stated this pass at the start of the cycle: the store was restored from a backup and lacks the
    /// cycle of the pass.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_stated: bool,
}

/// Returns what the tool touched, or may have touched: according to the findings, and without a finding according to
/// the permitted waypoints of each motion.
pub fn abraded_grids(findings: &[Finding], motions: &[MotionRecord]) -> Vec<AbradedGrid> {
    let mut all = Vec::new();
    let passes = findings.iter().filter(|finding| finding.kind == Kind::Abrade);
    for finding in passes.clone() {
        for (detail, how) in [("grids", AbrasionExtent::Whole), ("grids_in_part", AbrasionExtent::InPart)] {
            all.extend(finding.names(detail).into_iter().map(|grid| AbradedGrid {
                grid: Some(grid),
                pass: finding.pass,
                how,
            }));
        }
    }
    // A finding is stored just before the end of its motion, and only if the robot reported that end.
    let mut findings = passes;
    for record in motions.iter().filter(|record| record.motion.path == Path::Contact) {
        let found = if record.is_end_reported() { findings.next() } else { None };
        let pass = record.contact.as_ref().map_or(0, |contact| contact.path.pass);
        let Some(touched) = record.touched_grids() else {
            // An earlier version of this program recorded only the end, with its finding.
            let unknown = AbradedGrid { grid: None, pass, how: AbrasionExtent::PossiblyTouched };
            all.extend((!record.is_end_reported()).then_some(unknown));
            continue;
        };
        let reported_grids: Vec<String> = found
            .map(|finding| [finding.names("grids"), finding.names("grids_in_part")].concat())
            .unwrap_or_default();
        let unreported = touched.into_iter().filter(|touched| !reported_grids.contains(&touched.grid));
        all.extend(unreported.map(|TouchedGrid { grid, is_sure }| AbradedGrid {
            grid: Some(grid),
            pass,
            // A grid that the finding does not name was not reached, except possibly during the motion to the next
            // waypoint.
            how: if is_sure && found.is_none() { AbrasionExtent::Touched } else { AbrasionExtent::PossiblyTouched },
        }));
    }
    all
}

/// Returns the number of passes in which the tool was, or may have been, on the panel.
pub fn touching_passes(findings: &[Finding], motions: &[MotionRecord]) -> usize {
    let passes: BTreeSet<u8> = abraded_grids(findings, motions).into_iter().map(|abraded| abraded.pass).collect();
    passes.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::Motion;

    fn motion(outcome: Option<Outcome>, done: u32, (told, permitted): (u32, u32)) -> MotionRecord {
        let reached = |grid: &str, first| FirstReached { grid: grid.to_owned(), first };
        let grids = vec![reached("r1c1", 2), reached("r1c2", 10), reached("r1c3", 30)];
        let path = ContactPath { id: Id(9), pass: 1, grids, wears_mm2: 100.0 };
        MotionRecord {
            motion: Motion { epoch: 3, path: Path::Contact, plan: 7, waypoints: 40 },
            outcome,
            done,
            contact: Some(Contact { path, told, permitted }),
        }
    }

    fn touched(record: &MotionRecord) -> Vec<(String, bool)> {
        let touched = record.touched_grids().expect("it was kept");
        touched.into_iter().map(|touched| (touched.grid, touched.is_sure)).collect()
    }

    /// Calculated by hand: 4 waypoints were reported and 16 permitted, so r1c1 (2) was touched, r1c2 (10) may have
    /// been, and r1c3 (30) was not.
    #[test]
    fn an_unknown_end_lies_between_what_was_reported_and_what_was_permitted() {
        for outcome in [None, Some(Outcome::Cleared)] {
            let record = motion(outcome, 0, (4, 16));
            assert_eq!(record.executed_bounds(), Some(Bounds { at_least: 4, at_most: 16 }));
            assert_eq!(touched(&record), [("r1c1".to_owned(), true), ("r1c2".to_owned(), false)]);
        }
        assert_eq!(touched(&motion(None, 0, (0, 1))), [], "nothing was permitted that reaches a grid");
        let unkept = MotionRecord { contact: None, ..motion(None, 0, (0, 0)) };
        assert_eq!((unkept.executed_bounds(), unkept.touched_grids()), (None, None));
    }

    /// With 9 waypoints executed, the tool may have been on its way to waypoint 10.
    #[test]
    fn a_known_end_is_exact_but_for_the_way_to_the_next_waypoint() {
        let record = motion(Some(Outcome::Held), 9, (8, 32));
        assert_eq!(record.executed_bounds(), Some(Bounds { at_least: 9, at_most: 9 }));
        assert_eq!(touched(&record), [("r1c1".to_owned(), true), ("r1c2".to_owned(), false)]);
        assert_eq!(touched(&motion(Some(Outcome::Held), 0, (0, 32))), []);
        assert_eq!(touched(&motion(Some(Outcome::Done), 40, (40, 40))).len(), 3);
    }
}
