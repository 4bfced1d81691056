//! Two cycles side by side: their inputs, each check with its difference, and the history of each grid.
//!
//! If a phase was executed several times in a cycle, the last finding of each pass counts, because the cycle continued
//! with this finding.

use super::grid::GridPast;
use super::past_cycle::PastCycle;
use super::summary::{Summary, summary};
use panelprep_base::verdict::{Check, Limit};
use panelprep_cell::record::{Finding, Kind};
use serde::Serialize;
use std::collections::BTreeSet;

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
    pairs.sort_by_key(|pair| super::grid::grid_row_and_column(&pair.grid).unwrap_or((u32::MAX, 0)));
    pairs
}
