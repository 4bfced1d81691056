//! A past cycle, as used by the other modules of the history: its record, its part, the wear of the disc, and the
//! results of each grid of the panel (in the first film, in the passes, and in the last film). Also the summary of a
//! cycle, and the comparison of two cycles: their inputs, the difference of each check, and the history of each grid.
//!
//! If a phase was executed several times in a cycle, the comparison uses the last finding of each pass, because the
//! cycle continued with this finding.

use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Check, Limit, Reason, Verdict};
use panelprep_cell::record::{
    AbradedGrid, AbrasionExtent, Budget, Clock, CycleId, CycleRecord, Finding, Kind, PartNames, abraded_grids, name,
};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A cycle: its record and the data that are stored in addition to it.
#[derive(Debug, Clone, PartialEq)]
pub struct PastCycle {
    /// The record of the cycle.
    pub record: CycleRecord,
    /// The names of the part; `None` if no name was stated.
    pub part: Option<PartNames>,
    /// The wear of the disc; `None` if the cycle had no contact.
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
    /// Returns the findings of this kind, in order.
    pub fn findings(&self, kind: Kind) -> impl DoubleEndedIterator<Item = &Finding> {
        self.record.findings.iter().filter(move |finding| finding.kind == kind)
    }

    /// Returns the valid films ([`is_valid_film`]), in order.
    pub fn films(&self) -> impl DoubleEndedIterator<Item = &Finding> {
        self.findings(Kind::Inspect).filter(|film| is_valid_film(film))
    }

    /// Returns the check with this name in the last finding of this kind that contains it.
    pub fn last_check(&self, kind: Kind, name: &str) -> Option<&Check> {
        self.findings(kind).rev().find_map(|finding| finding.checks.iter().find(|check| check.name == name))
    }

    /// Returns the number of passes that were certainly in contact with the panel.
    pub fn touching_passes(&self) -> u8 {
        touching_passes(&self.record)
    }

    /// Returns all grids that a film or a pass reports.
    pub fn grids(&self) -> BTreeMap<String, GridPast> {
        grids(&self.films().collect::<Vec<_>>(), &abraded_grids(&self.record.findings, &self.record.motions))
    }

    /// Returns the duration of the cycle by the wall clock, s. `None` while it runs, or if the program ended during the
    /// cycle, so that the end of the cycle is unknown.
    pub fn cycle_time_s(&self) -> Option<i64> {
        let mut reasons = self.record.judgement.iter().flat_map(|judgement| &judgement.reasons);
        let is_interrupted = reasons.any(|reason| reason.code == "interrupted");
        Some(self.record.ended_unix_s? - self.record.started_unix_s).filter(|_| !is_interrupted)
    }
}

/// Returns the number of passes in a record that were certainly in contact with the panel.
pub fn touching_passes(record: &CycleRecord) -> u8 {
    let all = abraded_grids(&record.findings, &record.motions);
    all.iter().filter(|one| one.how.is_certain()).map(|one| one.pass).max().unwrap_or(0)
}

/// The history of a grid in a cycle. A value is `None` if the grid was not visible.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GridPast {
    /// Whether the grid failed in the first valid film.
    pub failed_first: Option<bool>,
    /// Time until the film on the grid broke in the first valid film, s.
    pub time_to_break_s: Option<f64>,
    /// Area of broken film on the grid in the first valid film, mm².
    pub broken_mm2: Option<f64>,
    /// Number of passes that were certainly in contact with the grid.
    pub passes: u8,
    /// Whether the grid failed in the last valid film.
    pub failed_at_end: Option<bool>,
}

impl GridPast {
    /// Returns the history of the grid as text.
    pub fn describe(&self) -> String {
        let first = match (self.failed_first, self.time_to_break_s) {
            (None, _) => "not seen in the first film".to_owned(),
            (Some(false), _) => "passed in the first film".to_owned(),
            (Some(true), None) => "failed in the first film".to_owned(),
            (Some(true), Some(time_s)) => format!("failed in the first film after {} s", fixed_decimals(time_s, 1)),
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

/// Returns the row and the column of a grid, from 1; `None` if the text is not a grid name such as `r1c1`.
pub fn grid_row_and_column(grid: &str) -> Option<(u32, u32)> {
    let (row, column) = grid.strip_prefix('r')?.split_once('c')?;
    Some((row.parse().ok()?, column.parse().ok()?))
}

/// Returns all grids that the films or the passes report. `films` contains valid films in their order.
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

/// Returns the grids that a film reports: whether each grid failed, and the area of broken film, mm².
pub fn reported_grids(film: &Finding) -> BTreeMap<String, (bool, Option<f64>)> {
    let failed = film.names("failed");
    let checks = film.checks.iter().filter_map(|check| {
        let grid = name::broken_film_grid(&check.name)?.to_owned();
        let is_failed = failed.contains(&grid);
        // A grid that was not completely visible has no result, unless its visible part has failed.
        (check.value.is_some() || is_failed).then_some((grid, (is_failed, check.value)))
    });
    checks.collect()
}

/// Returns whether a finding is a film with a result for its grids: it names the failed grids, and its verdict is
/// neither invalid nor aborted. Only such a film is treated as a test of a grid.
pub fn is_valid_film(film: &Finding) -> bool {
    film.kind == Kind::Inspect
        && film.details.contains_key("failed")
        && ![Verdict::Invalid, Verdict::Aborted].contains(&film.judgement.verdict)
}

/// Returns the grids that were partly sanded, or only touched, or possibly touched after the last valid film. Such
/// grids are left by a cycle that was interrupted in contact.
pub fn touched_grids(record: &CycleRecord) -> BTreeSet<String> {
    let last_film = record.findings.iter().filter(|one| is_valid_film(one)).map(|film| film.pass).max();
    let after = |one: &AbradedGrid| last_film.is_none_or(|film| one.pass > film);
    let unknown = |one: &AbradedGrid| one.how != AbrasionExtent::Whole;
    let all = abraded_grids(&record.findings, &record.motions).into_iter().filter(|one| after(one) && unknown(one));
    all.filter_map(|one| one.grid).collect()
}

/// Returns the state of each grid: the result of its last film, or that the grid was sanded after this film.
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

/// The summary of a cycle. A value that was not measured is `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Number of the cycle.
    pub cycle: CycleId,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End time of the cycle, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// Name of the panel.
    pub panel: String,
    /// The names of the part, as stated at the start.
    pub part: PartNames,
    /// Whether the cycle was an air-run, whose verdict refers to the motions, not to the panel.
    pub is_air_run: bool,
    /// The verdict; `None` while the cycle runs.
    pub verdict: Option<Verdict>,
    /// The reasons for the verdict.
    pub reasons: Vec<Reason>,
    /// Number of passes that were certainly in contact with the panel.
    pub passes: u8,
    /// The films of the cycle.
    pub films: Films,
    /// Point-to-plane residual of the localization, mm, with its limit.
    pub localization_residual: Option<Check>,
    /// Residual of the outline, px, with its limit.
    pub outline_residual: Option<Check>,
    /// Error of the localization at the worst place of the panel, 95 %, mm, with its limit.
    pub localization_error: Option<Check>,
    /// The components of the error at the tool, mm, 95 %.
    pub budget: Option<Budget>,
    /// The root of the sum of squares of these components, mm; `None` if a component is not measured.
    pub budget_total_mm: Option<f64>,
    /// Duration of the cycle by the wall clock, s.
    pub cycle_time_s: Option<i64>,
    /// Duration of the cycle by the clock of the simulated cell, s.
    pub simulated_s: Option<f64>,
    /// The wear of the disc; `None` if the cycle had no contact.
    pub disc: Option<DiscWear>,
}

/// The films of a cycle in its summary.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Films {
    /// Number of films with a valid result.
    pub valid: usize,
    /// Number of films without a valid result; these films were repeated, or ended the cycle.
    pub invalid: usize,
    /// Total observation time of the valid films, s.
    pub watched_s: Option<f64>,
    /// Number of grids that the first valid film reports.
    pub grids: usize,
    /// Grids that failed in the first valid film; `None` without a valid film.
    pub failed_first: Option<Vec<String>>,
    /// Grids that failed in the last valid film; `None` without a valid film.
    pub failed_at_end: Option<Vec<String>>,
}

/// Returns the summary of a cycle.
pub fn summary(past: &PastCycle) -> Summary {
    let record = &past.record;
    let located = |name: &str| past.last_check(Kind::Locate, name).cloned();
    let (verdict, reasons) = match record.judgement.clone() {
        Some(judgement) => (Some(judgement.verdict), judgement.reasons),
        None => (None, Vec::new()),
    };
    Summary {
        cycle: record.id,
        started_unix_s: record.started_unix_s,
        ended_unix_s: record.ended_unix_s,
        panel: record.panel.clone(),
        part: past.part.clone().unwrap_or_default(),
        is_air_run: record.is_air_run(),
        verdict,
        reasons,
        passes: past.touching_passes(),
        films: films(past),
        localization_residual: located(name::RESIDUAL),
        outline_residual: located(name::OUTLINE_RESIDUAL),
        localization_error: located(name::LOCATION_ERROR),
        budget: record.budget,
        budget_total_mm: record.budget.and_then(|budget| budget.total_mm()),
        cycle_time_s: past.cycle_time_s(),
        simulated_s: match record.clocks {
            [Some(Clock::Simulated { at_ms: from }), Some(Clock::Simulated { at_ms: to })] => {
                to.checked_sub(from).map(|ms| ms as f64 / 1_000.0)
            }
            _ => None,
        },
        disc: past.disc,
    }
}

pub(super) fn films(past: &PastCycle) -> Films {
    let valid = past.films().count();
    let watched: Vec<f64> = past.films().filter_map(|film| film.number(name::WATCHED_TIME_NAME)).collect();
    let failed = |film: Option<&panelprep_cell::record::Finding>| film.map(|film| film.names("failed"));
    Films {
        valid,
        invalid: past.findings(Kind::Inspect).count() - valid,
        watched_s: (!watched.is_empty()).then(|| watched.iter().sum()),
        grids: past.films().next().map_or(0, |film| reported_grids(film).len()),
        failed_first: failed(past.films().next()),
        failed_at_end: failed(past.films().next_back()),
    }
}

/// The comparison of two cycles; each pair contains the value of the first and of the second cycle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The summaries of both cycles.
    pub cycles: [Summary; 2],
    /// Whether both parts have the same serial number; `None` if one of them has none.
    pub is_same_part: Option<bool>,
    /// The inputs of both cycles: panel, recipe, calibrations, program.
    pub inputs: Vec<InputPair>,
    /// All checks of either cycle.
    pub checks: Vec<CheckPair>,
    /// All grids that either cycle reports.
    pub grids: Vec<GridPair>,
}

/// An input of both cycles, identified by its hash, name or version.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InputPair {
    /// Name of the input.
    pub name: String,
    /// The hash, name or version in each cycle; `None` if the cycle had no such input.
    pub values: [Option<String>; 2],
    /// Whether the input was the same in both cycles.
    pub is_same: bool,
}

/// A check in both cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckPair {
    /// The phase of the check.
    pub kind: Kind,
    /// Number of sanding passes that were planned before the check.
    pub pass: u8,
    /// Name of the check.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// The value in each cycle; `None` if it was not measured, or the cycle does not have the check.
    pub values: [Option<f64>; 2],
    /// The limit in each cycle; `None` if the cycle does not have the check.
    pub limits: [Option<Limit>; 2],
    /// The second value minus the first; `None` if either is missing.
    pub difference: Option<f64>,
}

/// A grid in both cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GridPair {
    /// Name of the grid.
    pub grid: String,
    /// The history of the grid in each cycle; `None` if the cycle does not report the grid.
    pub cycles: [Option<GridPast>; 2],
}

impl CheckPair {
    /// Returns whether the limits of both cycles differ, or only one cycle has the check.
    pub fn is_limit_different(&self) -> bool {
        self.limits[0] != self.limits[1]
    }
}

/// Returns the comparison of two cycles.
pub fn compare(first: &PastCycle, second: &PastCycle) -> Comparison {
    let serial = |past: &PastCycle| past.part.as_ref().and_then(|part| part.serial.clone());
    let both = serial(first).zip(serial(second));
    Comparison {
        cycles: [summary(first), summary(second)],
        is_same_part: both.map(|(first, second)| first == second),
        inputs: inputs(first, second),
        checks: checks(first, second),
        grids: grid_pairs(first, second),
    }
}

fn inputs(first: &PastCycle, second: &PastCycle) -> Vec<InputPair> {
    let of = |past: &PastCycle| -> Vec<(String, String)> {
        let record = &past.record;
        let named = [
            ("panel", &record.panel),
            ("taught version", &record.taught_version),
            ("recipe", &record.recipe_hash),
            ("program version", &record.program_version),
        ];
        let named = named.into_iter().map(|(name, value)| (name.to_owned(), value.clone()));
        named.chain(record.files.iter().map(|file| (file.name.clone(), file.hash.clone()))).collect()
    };
    let (first, second) = (of(first), of(second));
    let value = |all: &[(String, String)], name: &str| {
        all.iter().find(|(other, _)| other == name).map(|(_, value)| value.clone())
    };
    let pair = |name: &String| {
        let values = [value(&first, name), value(&second, name)];
        InputPair { name: name.clone(), is_same: values[0] == values[1], values }
    };
    union(&names(&first), &names(&second)).iter().map(pair).collect()
}

fn names(all: &[(String, String)]) -> Vec<String> {
    all.iter().map(|(name, _)| name.clone()).collect()
}

/// Returns the first list, followed by the entries that only the second list contains.
fn union<T: Clone + PartialEq>(first: &[T], second: &[T]) -> Vec<T> {
    let more = second.iter().filter(|one| !first.contains(one));
    first.iter().chain(more).cloned().collect()
}

/// Returns the last finding of each kind in each pass, in the order of their first occurrence.
fn last_findings(past: &PastCycle) -> Vec<(Kind, u8, &Finding)> {
    let mut last: Vec<(Kind, u8, &Finding)> = Vec::new();
    for finding in &past.record.findings {
        match last.iter_mut().find(|(kind, pass, _)| (*kind, *pass) == (finding.kind, finding.pass)) {
            Some(found) => found.2 = finding,
            None => last.push((finding.kind, finding.pass, finding)),
        }
    }
    last
}

fn checks(first: &PastCycle, second: &PastCycle) -> Vec<CheckPair> {
    let both = [last_findings(first), last_findings(second)];
    let phases = |index: usize| both[index].iter().map(|(kind, pass, _)| (*kind, *pass)).collect::<Vec<_>>();
    let mut pairs = Vec::new();
    for (kind, pass) in union(&phases(0), &phases(1)) {
        let checks_of = |index: usize| -> &[Check] {
            let found = both[index].iter().find(|(other, number, _)| (*other, *number) == (kind, pass));
            found.map_or(&[], |(.., finding)| &finding.checks)
        };
        let named = |checks: &[Check]| checks.iter().map(|check| check.name.clone()).collect::<Vec<_>>();
        for name in union(&named(checks_of(0)), &named(checks_of(1))) {
            let found = [0, 1].map(|index| checks_of(index).iter().find(|check| check.name == name));
            let values = found.map(|check| check.and_then(|check| check.value));
            pairs.push(CheckPair {
                kind,
                pass,
                unit: found.into_iter().flatten().next().map_or(String::new(), |check| check.unit.clone()),
                name,
                values,
                limits: found.map(|check| check.map(|check| check.limit)),
                difference: values[0].zip(values[1]).map(|(first, second)| second - first),
            });
        }
    }
    pairs
}

fn grid_pairs(first: &PastCycle, second: &PastCycle) -> Vec<GridPair> {
    let both = [first.grids(), second.grids()];
    let names: BTreeSet<&String> = both.iter().flat_map(|grids| grids.keys()).collect();
    let mut pairs: Vec<GridPair> = names
        .into_iter()
        .map(|grid| GridPair { grid: grid.clone(), cycles: [0, 1].map(|index| both[index].get(grid).cloned()) })
        .collect();
    // The order is by row and column number, so that r2c1 comes before r10c1.
    pairs.sort_by_key(|pair| grid_row_and_column(&pair.grid).unwrap_or((u32::MAX, 0)));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Judgement;
    use panelprep_cell::record::Check;

    fn finding(kind: Kind, verdict: Verdict) -> Finding {
        Finding::new(kind, 0, Judgement { verdict, reasons: vec![] })
    }

    /// A grid that was not visible in any film is not reported as whole, an invalid film has no result, and a sanding
    /// pass determines the state of the grid until the next film.
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
        // A film that was aborted, or does not name failed grids, is not a test of any grid.
        findings.push(film(Verdict::Aborted, &["r1c1", "r1c2", "r1c3"], &["r1c1"]));
        let unfinished = Check::new(name::broken_film("r1c3"), "mm²", Some(0.0));
        findings.push(finding(Kind::Inspect, Verdict::Review).with_checks([unfinished]));
        assert_eq!(of(&findings), [pair("r1c1", "whole"), pair("r1c2", "abraded")]);
        findings.push(film(Verdict::Pass, &["r1c1", "r1c2", "r1c3"], &[]));
        assert!(of(&findings).iter().all(|(_, state)| *state == "whole"));
    }
}
