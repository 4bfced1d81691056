//! How far a contact path may have been executed, and which grids it may have touched.
//!
//! Before a waypoint in contact may be sent, the store keeps that it may be: waypoints are permitted in blocks. So after
//! any end — a crash, a lost link — the robot has executed at least what it told and at most what was permitted. With the
//! waypoint from which on the disc reaches each grid, that bounds what was touched.

use super::finding::{CycleId, Finding, Kind};
use crate::cycle::{Id, Motion, Outcome, Path};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A motion as it was committed before its first waypoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionRecord {
    /// The motion.
    pub motion: Motion,
    /// How it ended; `None` while it is open.
    pub outcome: Option<Outcome>,
    /// Waypoints executed, as the robot said at its end; without meaning where it did not.
    pub done: u32,
    /// Of a contact path what it works on, as far as it was kept.
    pub contact: Option<Contact>,
}

/// What a contact path works on; committed with the motion, before its first waypoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContactPath {
    /// The act that moves, by which the robot's progress is told.
    pub id: Id,
    /// Which pass, from 1.
    pub pass: u8,
    /// The planned grids, each with the first waypoint on whose way the disc reaches it.
    pub grids: Vec<Reached>,
    /// What the whole path wears of the disc, mm²; counted before it begins.
    pub wears_mm2: f64,
}

/// From where on a grid is touched.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reached {
    /// The grid.
    pub grid: String,
    /// The waypoint, counted as [`Motion::waypoints`](crate::cycle::Motion::waypoints) counts, from 1.
    pub first: u32,
}

/// A contact path, what the robot told of it and what it was permitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The path.
    pub path: ContactPath,
    /// Waypoints executed, as far as the robot told.
    pub told: u32,
    /// Waypoints that were permitted to be sent.
    pub permitted: u32,
}

/// Bounds of a number of waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bounds {
    /// So many were executed.
    pub at_least: u32,
    /// No more can have been.
    pub at_most: u32,
}

/// A grid that the tool touched, or may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Touched {
    /// The grid.
    pub grid: String,
    /// Whether a waypoint on it is known to be executed.
    pub is_sure: bool,
}

impl MotionRecord {
    /// Whether the robot told how the motion ended. It did not where the motion is open, or where a person cleared it.
    pub fn end_is_known(&self) -> bool {
        self.outcome.is_some_and(|outcome| outcome != Outcome::Cleared)
    }

    /// How many waypoints were executed; `None` where nothing was kept that bounds it.
    pub fn executed(&self) -> Option<Bounds> {
        if self.end_is_known() {
            return Some(Bounds { at_least: self.done, at_most: self.done });
        }
        let contact = self.contact.as_ref()?;
        Some(Bounds { at_least: contact.told, at_most: contact.permitted.max(contact.told) })
    }

    /// The grids that were touched, or may have been; `None` where that was not kept. None are for other motions.
    pub fn touched(&self) -> Option<Vec<Touched>> {
        if self.motion.path != Path::Contact {
            return Some(Vec::new());
        }
        let (contact, executed) = (self.contact.as_ref()?, self.executed()?);
        // Where the robot told its end, it may have been on its way to the next waypoint.
        let begun = executed.at_most + u32::from(self.end_is_known());
        let grids = contact.path.grids.iter().filter(|reached| reached.first <= begun);
        let touched =
            |reached: &Reached| Touched { grid: reached.grid.clone(), is_sure: reached.first <= executed.at_least };
        Some(grids.map(touched).collect())
    }
}

/// What the tool did to a grid in a pass.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Abraded {
    /// The grid; `None` stands for any: which ones was not kept.
    pub grid: Option<String>,
    /// The pass.
    pub pass: u8,
    /// How far it went.
    pub how: How,
}

/// How far a grid was abraded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// As planned.
    Whole,
    /// In part, by the poses that the robot reported.
    InPart,
    /// It was touched; how much of it is not known.
    Touched,
    /// It may have been touched: nobody knows.
    Perhaps,
}

impl How {
    /// Whether the tool was on the grid.
    pub fn is_sure(self) -> bool {
        self != How::Perhaps
    }
}

/// Where the tool was in an earlier cycle of the same panel, or may have been.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EarlierPass {
    /// The cycle.
    pub cycle: CycleId,
    /// Its pass.
    pub pass: u8,
    /// The grid; `None` stands for any.
    pub grid: Option<String>,
    /// Whether it is known that the grid was touched.
    pub is_sure: bool,
}

/// What the tool touched, or may have, by what was found and, where nothing was, by what each motion was permitted.
pub fn abraded(findings: &[Finding], motions: &[MotionRecord]) -> Vec<Abraded> {
    let mut all = Vec::new();
    let passes = findings.iter().filter(|finding| finding.kind == Kind::Abrade);
    for finding in passes.clone() {
        for (detail, how) in [("grids", How::Whole), ("grids_in_part", How::InPart)] {
            all.extend(finding.names(detail).into_iter().map(|grid| Abraded {
                grid: Some(grid),
                pass: finding.pass,
                how,
            }));
        }
    }
    // A finding is kept just before the end of its motion, and only where the robot told that end.
    let mut findings = passes;
    for record in motions.iter().filter(|record| record.motion.path == Path::Contact) {
        let found = if record.end_is_known() { findings.next() } else { None };
        let pass = record.contact.as_ref().map_or(0, |contact| contact.path.pass);
        let Some(touched) = record.touched() else {
            // An earlier program kept the end alone, with its finding.
            let unknown = Abraded { grid: None, pass, how: How::Perhaps };
            all.extend((!record.end_is_known()).then_some(unknown));
            continue;
        };
        let told: Vec<String> = found
            .map(|finding| [finding.names("grids"), finding.names("grids_in_part")].concat())
            .unwrap_or_default();
        let untold = touched.into_iter().filter(|touched| !told.contains(&touched.grid));
        all.extend(untold.map(|Touched { grid, is_sure }| Abraded {
            grid: Some(grid),
            pass,
            // What a finding does not name was not reached, but for the waypoint that was under way.
            how: if is_sure && found.is_none() { How::Touched } else { How::Perhaps },
        }));
    }
    all
}

/// In how many passes the tool was on the panel, or may have been.
pub fn passes(findings: &[Finding], motions: &[MotionRecord]) -> usize {
    let passes: BTreeSet<u8> = abraded(findings, motions).into_iter().map(|abraded| abraded.pass).collect();
    passes.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::Motion;

    fn motion(outcome: Option<Outcome>, done: u32, (told, permitted): (u32, u32)) -> MotionRecord {
        let reached = |grid: &str, first| Reached { grid: grid.to_owned(), first };
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
        let touched = record.touched().expect("it was kept");
        touched.into_iter().map(|touched| (touched.grid, touched.is_sure)).collect()
    }

    /// By hand: told 4 and permitted 16, so r1c1 (2) was touched, r1c2 (10) may have been, and r1c3 (30) was not.
    #[test]
    fn an_unknown_end_lies_between_what_was_told_and_what_was_permitted() {
        for outcome in [None, Some(Outcome::Cleared)] {
            let record = motion(outcome, 0, (4, 16));
            assert_eq!(record.executed(), Some(Bounds { at_least: 4, at_most: 16 }));
            assert_eq!(touched(&record), [("r1c1".to_owned(), true), ("r1c2".to_owned(), false)]);
        }
        assert_eq!(touched(&motion(None, 0, (0, 1))), [], "nothing was permitted that reaches a grid");
        let unkept = MotionRecord { contact: None, ..motion(None, 0, (0, 0)) };
        assert_eq!((unkept.executed(), unkept.touched()), (None, None));
    }

    /// At 9 executed the tool may have been on its way to 10.
    #[test]
    fn a_known_end_is_exact_but_for_the_way_to_the_next_waypoint() {
        let record = motion(Some(Outcome::Held), 9, (8, 32));
        assert_eq!(record.executed(), Some(Bounds { at_least: 9, at_most: 9 }));
        assert_eq!(touched(&record), [("r1c1".to_owned(), true), ("r1c2".to_owned(), false)]);
        assert_eq!(touched(&motion(Some(Outcome::Held), 0, (0, 32))), []);
        assert_eq!(touched(&motion(Some(Outcome::Done), 40, (40, 40))).len(), 3);
    }
}
