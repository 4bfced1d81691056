//! A past cycle, as the other modules of the history read it: its record, its part, and the wear of the disc.

use super::grid::{GridPast, grids, is_valid_film};
use panelprep_base::verdict::Check;
use panelprep_cell::record::{CycleRecord, Finding, Kind, PartNames, abraded_grids};
use serde::Serialize;
use std::collections::BTreeMap;

/// A cycle with the data that are stored in addition to its record.
#[derive(Debug, Clone, PartialEq)]
pub struct PastCycle {
    /// The record.
    pub record: CycleRecord,
    /// The part; `None` if none was named.
    pub part: Option<PartNames>,
    /// The disc; `None` if the cycle touched nothing.
    pub disc: Option<DiscWear>,
}

/// The wear of the disc in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DiscWear {
    /// The area of the panel that the disc swept in this cycle, mm².
    pub swept_mm2: f64,
    /// The area that the disc had swept since it was mounted, at the end of the cycle, mm².
    pub worn_mm2: f64,
}

impl PastCycle {
    /// Returns the findings of this phase, in order.
    pub fn findings(&self, kind: Kind) -> impl DoubleEndedIterator<Item = &Finding> {
        self.record.findings.iter().filter(move |finding| finding.kind == kind)
    }

    /// The valid films: those with a judgement other than invalid, in order.
    pub fn films(&self) -> impl DoubleEndedIterator<Item = &Finding> {
        self.findings(Kind::Inspect).filter(|film| is_valid_film(film))
    }

    /// Returns the check with this name in the last finding of this phase that has it.
    pub fn last_check(&self, kind: Kind, name: &str) -> Option<&Check> {
        self.findings(kind).rev().find_map(|finding| finding.checks.iter().find(|check| check.name == name))
    }

    /// Returns the number of passes over the panel that are known to have touched it.
    pub fn touching_passes(&self) -> u8 {
        touching_passes(&self.record)
    }

    /// Every grid that a film or a pass reports.
    pub fn grids(&self) -> BTreeMap<String, GridPast> {
        grids(&self.films().collect::<Vec<_>>(), &abraded_grids(&self.record.findings, &self.record.motions))
    }

    /// Duration of the cycle from its begin to its end by the wall clock, s. `None` while it runs, or if the program
    /// ended before the cycle did, so that the cycle's end is unknown.
    pub fn cycle_time_s(&self) -> Option<i64> {
        let mut reasons = self.record.judgement.iter().flat_map(|judgement| &judgement.reasons);
        let is_interrupted = reasons.any(|reason| reason.code == "interrupted");
        Some(self.record.ended_unix_s? - self.record.started_unix_s).filter(|_| !is_interrupted)
    }
}

/// Returns the number of this cycle's passes over the panel that are known to have touched it.
pub fn touching_passes(record: &CycleRecord) -> u8 {
    let all = abraded_grids(&record.findings, &record.motions);
    all.iter().filter(|one| one.how.is_certain()).map(|one| one.pass).max().unwrap_or(0)
}
