//! Bounds for the executed part of a contact path, and the grids that the tool may have touched.
//!
//! Waypoints in contact are permitted in blocks: before a waypoint may be sent, the permission is stored. Therefore,
//! after any end (a crash, a lost link), the robot has executed at least the reported and at most the permitted
//! waypoints. Together with the first waypoint of each grid, this gives the grids that the tool may have touched.

use super::finding::{CycleId, Finding, Kind};
use crate::cycle::{Id, Motion, Outcome, Path};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A motion; stored before its first waypoint is sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionRecord {
    /// The motion that was committed.
    pub motion: Motion,
    /// The outcome of the motion; `None` while it is in progress.
    pub outcome: Option<Outcome>,
    /// Number of executed waypoints that the robot reported at the end of the motion; undefined without a report.
    pub done: u32,
    /// For a contact path: its grids and its progress, if they were recorded.
    pub contact: Option<Contact>,
}

/// The grids, the sanding pass and the wear of a contact path; stored with the motion, before its first waypoint is
/// sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContactPath {
    /// The id of the action that starts the motion; the robot reports its progress with this id.
    pub id: Id,
    /// Number of the sanding pass, from 1.
    pub pass: u8,
    /// The planned grids, each with the first waypoint at which the disc reaches it.
    pub grids: Vec<FirstReached>,
    /// Wear of the disc by the whole path, mm²; counted before the path begins.
    pub wears_mm2: f64,
}

/// A grid, with the first waypoint at which the disc reaches it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FirstReached {
    /// The name of the grid.
    pub grid: String,
    /// Number of this waypoint, from 1, counted like [`Motion::waypoints`](crate::cycle::Motion::waypoints).
    pub first: u32,
}

/// A contact path, with the reported and the permitted number of waypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The path that was committed.
    pub path: ContactPath,
    /// Number of executed waypoints that the robot has reported.
    pub told: u32,
    /// Number of waypoints that may be sent.
    pub permitted: u32,
}

/// Lower and upper bound of the number of executed waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bounds {
    /// Number of waypoints that were certainly executed.
    pub at_least: u32,
    /// Number of waypoints that can have been executed at most.
    pub at_most: u32,
}

/// A grid that the tool has touched, or may have touched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TouchedGrid {
    /// The name of the grid.
    pub grid: String,
    /// Whether a waypoint of the grid was certainly executed.
    pub is_sure: bool,
}

impl MotionRecord {
    /// Returns whether the robot reported the end of the motion. It did not if the motion is still open, or if a person
    /// cleared it.
    pub fn is_end_reported(&self) -> bool {
        self.outcome.is_some_and(|outcome| outcome != Outcome::Cleared)
    }

    /// Returns bounds for the number of executed waypoints; `None` if no bound was stored.
    pub fn executed_bounds(&self) -> Option<Bounds> {
        if self.is_end_reported() {
            return Some(Bounds { at_least: self.done, at_most: self.done });
        }
        let contact = self.contact.as_ref()?;
        Some(Bounds { at_least: contact.told, at_most: contact.permitted.max(contact.told) })
    }

    /// Returns the grids that the tool has touched, or may have touched; `None` if the grids were not stored. Empty for
    /// motions without contact.
    pub fn touched_grids(&self) -> Option<Vec<TouchedGrid>> {
        if self.motion.path != Path::Contact {
            return Some(Vec::new());
        }
        let (contact, executed) = (self.contact.as_ref()?, self.executed_bounds()?);
        // Even after a reported end, the tool may already have moved towards the next waypoint.
        let begun = executed.at_most + u32::from(self.is_end_reported());
        let grids = contact.path.grids.iter().filter(|reached| reached.first <= begun);
        let touched = |reached: &FirstReached| TouchedGrid {
            grid: reached.grid.clone(),
            is_sure: reached.first <= executed.at_least,
        };
        Some(grids.map(touched).collect())
    }
}

/// How a grid was sanded in a pass.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AbradedGrid {
    /// The grid; `None` for any grid, because the grids were not stored.
    pub grid: Option<String>,
    /// Number of the sanding pass.
    pub pass: u8,
    /// The extent to which the grid was sanded.
    pub how: AbrasionExtent,
}

/// The extent to which a grid was sanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AbrasionExtent {
    /// The grid was sanded as planned.
    Whole,
    /// The grid was partly sanded, according to the poses that the robot reported.
    InPart,
    /// The tool was on the grid; the sanded part is unknown.
    Touched,
    /// The tool may have been on the grid.
    PossiblyTouched,
}

impl AbrasionExtent {
    /// Returns whether the tool was certainly on the grid.
    pub fn is_certain(self) -> bool {
        self != AbrasionExtent::PossiblyTouched
    }
}

/// A certain or possible contact between the tool and a grid in an earlier cycle with the same part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EarlierPass {
    /// Number of the earlier cycle.
    pub cycle: CycleId,
    /// Number of the sanding pass.
    pub pass: u8,
    /// The grid; `None` for any grid.
    pub grid: Option<String>,
    /// Whether the contact is certain.
    pub is_sure: bool,
    /// Whether a person stated this pass in a start request, because the store was restored from a backup and its cycle
    /// is missing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_stated: bool,
}

/// Returns the grids that were sanded, or may have been: according to the findings or, for a motion without a finding,
/// according to its permitted waypoints.
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
    // A finding is stored immediately before the end of its motion, and only if the robot reported this end.
    let mut findings = passes;
    for record in motions.iter().filter(|record| record.motion.path == Path::Contact) {
        let found = if record.is_end_reported() { findings.next() } else { None };
        let pass = record.contact.as_ref().map_or(0, |contact| contact.path.pass);
        let Some(touched) = record.touched_grids() else {
            // Without a stored path, only the finding states what was touched.
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
            // A grid that the finding does not name was not reached, except possibly on the way to the next waypoint.
            how: if is_sure && found.is_none() { AbrasionExtent::Touched } else { AbrasionExtent::PossiblyTouched },
        }));
    }
    all
}

/// Returns the number of passes in which the tool was, or may have been, in contact with the panel.
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

    /// Expected values, calculated by hand: 4 waypoints were reported and 16 permitted. So the tool has touched r1c1
    /// (first waypoint 2), may have touched r1c2 (10), and has not touched r1c3 (30).
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

    /// After 9 executed waypoints, the tool may have moved towards waypoint 10.
    #[test]
    fn a_known_end_is_exact_but_for_the_way_to_the_next_waypoint() {
        let record = motion(Some(Outcome::Held), 9, (8, 32));
        assert_eq!(record.executed_bounds(), Some(Bounds { at_least: 9, at_most: 9 }));
        assert_eq!(touched(&record), [("r1c1".to_owned(), true), ("r1c2".to_owned(), false)]);
        assert_eq!(touched(&motion(Some(Outcome::Held), 0, (0, 32))), []);
        assert_eq!(touched(&motion(Some(Outcome::Done), 40, (40, 40))).len(), 3);
    }
}
