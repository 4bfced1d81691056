//! A past cycle, as the other modules of the history read it: its record, its part, the wear of the disc, and the
//! results of each grid of the panel (for its first film, the passes, and its last film).

use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Check, Verdict};
use panelprep_cell::record::{
    AbradedGrid, AbrasionExtent, CycleRecord, Finding, Kind, PartNames, abraded_grids, name,
};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

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

/// The history of a grid in one cycle; a value is `None` if the grid was not seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GridPast {
    /// Whether the film broke on the grid in the first valid film.
    pub failed_first: Option<bool>,
    /// Time to the break on the grid in the first valid film, s.
    pub time_to_break_s: Option<f64>,
    /// The area of the break on the grid in the first valid film, mm².
    pub broken_mm2: Option<f64>,
    /// Number of passes that are known to have touched the grid.
    pub passes: u8,
    /// Whether the film broke on the grid in the last valid film.
    pub failed_at_end: Option<bool>,
}

impl GridPast {
    /// The grid's history in words.
    pub fn describe(&self) -> String {
        let first = match (self.failed_first, self.time_to_break_s) {
            (None, _) => "not seen first".to_owned(),
            (Some(false), _) => "passed first".to_owned(),
            (Some(true), None) => "failed first".to_owned(),
            (Some(true), Some(time_s)) => format!("failed first after {} s", fixed_decimals(time_s, 1)),
        };
        let passes = match self.passes {
            0 => String::new(),
            1 => ", abraded once".to_owned(),
            passes => format!(", abraded {passes} times"),
        };
        let end = match self.failed_at_end {
            None => ", not seen in the last film",
            Some(false) => ", passed in the last film",
            Some(true) => ", failed in the last film",
        };
        format!("{first}{passes}{end}")
    }
}

/// The row and the column of a grid, from 1; `None` if the name is not a grid name such as `r1c1`.
pub fn grid_row_and_column(grid: &str) -> Option<(u32, u32)> {
    let (row, column) = grid.strip_prefix('r')?.split_once('c')?;
    Some((row.parse().ok()?, column.parse().ok()?))
}

/// Returns every grid that the films or the passes report. The films are in order, and none is invalid.
pub(super) fn grids(films: &[&Finding], passes: &[AbradedGrid]) -> BTreeMap<String, GridPast> {
    let mut all: BTreeMap<String, GridPast> = BTreeMap::new();
    let mut first = films.first().map(|film| reported_grids(film)).unwrap_or_default();
    for (grid, (failed, broken_mm2)) in std::mem::take(&mut first) {
        let time_to_break_s = films.first().and_then(|film| film.number(&name::break_time_name(&grid)));
        let past = all.entry(grid).or_default();
        *past = GridPast { failed_first: Some(failed), time_to_break_s, broken_mm2, ..GridPast::default() };
    }
    for (grid, (failed, _)) in films.last().map(|film| reported_grids(film)).unwrap_or_default() {
        all.entry(grid).or_default().failed_at_end = Some(failed);
    }
    for one in passes.iter().filter(|one| one.how.is_certain()) {
        if let Some(grid) = &one.grid {
            all.entry(grid.clone()).or_default().passes += 1;
        }
    }
    all
}

/// The grids that a film reports: whether it broke, and on which area, mm².
pub fn reported_grids(film: &Finding) -> BTreeMap<String, (bool, Option<f64>)> {
    let failed = film.names("failed");
    let checks = film.checks.iter().filter_map(|check| {
        let grid = name::broken_film_grid(&check.name)?.to_owned();
        let is_failed = failed.contains(&grid);
        // A grid that was not seen gives no information, unless the part that was seen broke.
        (check.value.is_some() || is_failed).then_some((grid, (is_failed, check.value)))
    });
    checks.collect()
}

/// Returns whether a finding is a film with a result for its grids: it names the failed grids, and its verdict is
/// neither invalid nor aborted. Only such a film counts as a test of a grid.
pub fn is_valid_film(film: &Finding) -> bool {
    film.kind == Kind::Inspect
        && film.details.contains_key("failed")
        && ![Verdict::Invalid, Verdict::Aborted].contains(&film.judgement.verdict)
}

/// The grids that the tool sanded only in part, or touched, or may have touched, after the last valid film. A cycle
/// that was cut short in contact leaves such grids.
pub fn touched_grids(record: &CycleRecord) -> BTreeSet<String> {
    let last_film = record.findings.iter().filter(|one| is_valid_film(one)).map(|film| film.pass).max();
    let after = |one: &AbradedGrid| last_film.is_none_or(|film| one.pass > film);
    let unknown = |one: &AbradedGrid| one.how != AbrasionExtent::Whole;
    let all = abraded_grids(&record.findings, &record.motions).into_iter().filter(|one| after(one) && unknown(one));
    all.filter_map(|one| one.grid).collect()
}

/// The state of each grid that was seen: the result of the last film, and abrasion after it.
pub fn grid_states(findings: &[Finding]) -> BTreeMap<String, &'static str> {
    let mut grids = BTreeMap::new();
    for finding in findings {
        match finding.kind {
            Kind::Inspect if is_valid_film(finding) => {
                let seen = reported_grids(finding).into_iter();
                grids.extend(seen.map(|(grid, (failed, _))| (grid, if failed { "broke" } else { "whole" })));
            }
            Kind::Abrade => grids.extend(finding.names("grids").into_iter().map(|grid| (grid, "abraded"))),
            _ => {}
        }
    }
    grids
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Judgement;
    use panelprep_cell::record::Check;

    fn finding(kind: Kind, verdict: Verdict) -> Finding {
        Finding::new(kind, 0, Judgement { verdict, reasons: vec![] })
    }

    /// A grid that no film saw does not count as whole, an invalid film gives no result, and an abrasion is the grid's
    /// state until the next film.
    #[test]
    fn a_grid_has_the_state_of_its_last_film_and_abrasion() {
        let film = |verdict, seen: &[&str], failed: &[&str]| {
            let checks = ["r1c1", "r1c2", "r1c3"].map(|grid| {
                let value = seen.contains(&grid).then_some(1.0);
                Check::new(name::broken_film(grid), "mm²", value)
            });
            finding(Kind::Inspect, verdict).with_detail("failed", failed.to_vec()).with_checks(checks)
        };
        let mut findings = vec![film(Verdict::Fail, &["r1c1", "r1c2"], &["r1c2"])];
        let of = |findings: &[Finding]| grid_states(findings).into_iter().collect::<Vec<_>>();
        let pair = |grid: &str, state| (grid.to_owned(), state);
        assert_eq!(of(&findings), [pair("r1c1", "whole"), pair("r1c2", "broke")]);
        findings.push(finding(Kind::Abrade, Verdict::Pass).with_detail("grids", vec!["r1c2"]));
        findings.push(film(Verdict::Invalid, &["r1c1"], &["r1c1"]));
        assert_eq!(of(&findings), [pair("r1c1", "whole"), pair("r1c2", "abraded")]);
        // A film that was aborted, or that names no failed grids, tests no grid.
        findings.push(film(Verdict::Aborted, &["r1c1", "r1c2", "r1c3"], &["r1c1"]));
        let unfinished = Check::new(name::broken_film("r1c3"), "mm²", Some(0.0));
        findings.push(finding(Kind::Inspect, Verdict::Review).with_checks([unfinished]));
        assert_eq!(of(&findings), [pair("r1c1", "whole"), pair("r1c2", "abraded")]);
        findings.push(film(Verdict::Pass, &["r1c1", "r1c2", "r1c3"], &[]));
        assert!(of(&findings).iter().all(|(_, state)| *state == "whole"));
    }
}
