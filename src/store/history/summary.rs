//! The summary of one cycle, and two cycles side by side: their inputs, each check with its difference, and the
//! history of each grid.
//!
//! If a phase was executed several times in a cycle, the comparison uses the last finding of each pass, because the
//! cycle continued with this finding.

use super::past_cycle::{DiscWear, GridPast, PastCycle};
use panelprep_base::verdict::{Check, Limit, Reason, Verdict};
use panelprep_cell::record::{Budget, Clock, CycleId, Finding, Kind, PartNames, name};
use serde::Serialize;
use std::collections::BTreeSet;

/// The results of one cycle. A value that was not measured is `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Its number.
    pub cycle: CycleId,
    /// Time at which the cycle began, s since 1970.
    pub started_unix_s: i64,
    /// Time at which the cycle ended, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The part, with the names that were entered.
    pub part: PartNames,
    /// Whether the path was run in the air: the verdict is then about the motions, not about the panel.
    pub is_air_run: bool,
    /// How the cycle ended; `None` while it runs.
    pub verdict: Option<Verdict>,
    /// The reasons for the verdict.
    pub reasons: Vec<Reason>,
    /// Passes over the panel that are known to have touched it.
    pub passes: u8,
    /// The films.
    pub films: Films,
    /// The residual of the localization, point to plane, mm, with its limit.
    pub localization_residual: Option<Check>,
    /// The residual of the outline, px, with its limit.
    pub outline_residual: Option<Check>,
    /// The stated error of the localization at the panel's worst place, 95 %, mm, with its limit.
    pub localization_error: Option<Check>,
    /// The error at the tool, divided into its parts, mm, 95 %.
    pub budget: Option<Budget>,
    /// The root of the sum of squares of the budget's parts, mm; `None` while a part is not measured.
    pub budget_total_mm: Option<f64>,
    /// Duration of the cycle by the wall clock, s.
    pub cycle_time_s: Option<i64>,
    /// Duration of the cycle by the simulated cell's clock, s.
    pub simulated_s: Option<f64>,
    /// The disc; `None` if the cycle touched nothing.
    pub disc: Option<DiscWear>,
}

/// The films of a cycle.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Films {
    /// Films with a valid result.
    pub valid: usize,
    /// Films without a valid result; they were repeated, or ended the cycle.
    pub invalid: usize,
    /// Total time for which the valid films were watched, s.
    pub watched_s: Option<f64>,
    /// Number of grids that the first valid film reports.
    pub grids: usize,
    /// Grids on which the first valid film broke; `None` without a valid film.
    pub failed_first: Option<Vec<String>>,
    /// Grids on which the last valid film broke; `None` without a valid film.
    pub failed_at_end: Option<Vec<String>>,
}

/// Summarises a cycle.
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
        grids: past.films().next().map_or(0, |film| super::past_cycle::reported_grids(film).len()),
        failed_first: failed(past.films().next()),
        failed_at_end: failed(past.films().next_back()),
    }
}

/// Two cycles side by side, the first and the second in each pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The summary of each cycle.
    pub cycles: [Summary; 2],
    /// Whether both have the same serial number; `None` if one has none.
    pub is_same_part: Option<bool>,
    /// The inputs of the cycles: panel, recipe, calibrations, program.
    pub inputs: Vec<InputPair>,
    /// Every check that one of the cycles has.
    pub checks: Vec<CheckPair>,
    /// Every grid that one of them reports.
    pub grids: Vec<GridPair>,
}

/// An input of both cycles, by its hash, name or version.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InputPair {
    /// Name of the input.
    pub name: String,
    /// The values; `None` if the cycle had none.
    pub values: [Option<String>; 2],
    /// Whether both cycles ran with the same input.
    pub is_same: bool,
}

/// A check of both cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckPair {
    /// The phase.
    pub kind: Kind,
    /// Number of abrasions planned before the check.
    pub pass: u8,
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The values; `None` if it was not measured, or the cycle does not have it.
    pub values: [Option<f64>; 2],
    /// The limits; `None` if the cycle does not have the check.
    pub limits: [Option<Limit>; 2],
    /// The second value minus the first; `None` if one of them is missing.
    pub difference: Option<f64>,
}

/// The history of a grid in both cycles; `None` for a cycle that does not report the grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GridPair {
    /// The grid.
    pub grid: String,
    /// The grid's history in each cycle.
    pub cycles: [Option<GridPast>; 2],
}

impl CheckPair {
    /// Whether the limits differ, or only one cycle has the check.
    pub fn is_limit_different(&self) -> bool {
        self.limits[0] != self.limits[1]
    }
}

/// Compares two cycles.
pub fn compare(first: &PastCycle, second: &PastCycle) -> Comparison {
    let serial = |past: &PastCycle| past.part.as_ref().and_then(|part| part.serial.clone());
    let both = serial(first).zip(serial(second));
    Comparison {
        cycles: [summary(first), summary(second)],
        is_same_part: both.map(|(first, second)| first == second),
        inputs: inputs(first, second),
        checks: checks(first, second),
        grids: grids(first, second),
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

/// Returns the first list, then the entries that only the second list has, in their orders.
fn union<T: Clone + PartialEq>(first: &[T], second: &[T]) -> Vec<T> {
    let more = second.iter().filter(|one| !first.contains(one));
    first.iter().chain(more).cloned().collect()
}

/// Returns the last finding of each pair of phase and pass, in the order of their first occurrence.
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

fn grids(first: &PastCycle, second: &PastCycle) -> Vec<GridPair> {
    let both = [first.grids(), second.grids()];
    let names: BTreeSet<&String> = both.iter().flat_map(|grids| grids.keys()).collect();
    let mut pairs: Vec<GridPair> = names
        .into_iter()
        .map(|grid| GridPair { grid: grid.clone(), cycles: [0, 1].map(|index| both[index].get(grid).cloned()) })
        .collect();
    // By number: r2c1 comes before r10c1.
    pairs.sort_by_key(|pair| super::past_cycle::grid_row_and_column(&pair.grid).unwrap_or((u32::MAX, 0)));
    pairs
}
