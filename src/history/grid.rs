//! What became of each grid of a panel in one cycle: by its first film, by the passes, by its last film.

use crate::record::{Abraded, Finding, name};
use crate::words::fixed;
use serde::Serialize;
use std::collections::BTreeMap;

/// What became of a grid in one cycle; `None` where it was not seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GridPast {
    /// Whether the film broke on it the first time.
    pub failed_first: Option<bool>,
    /// After how long it failed then, s.
    pub time_to_break_s: Option<f64>,
    /// The area on which the film broke then, mm².
    pub broken_mm2: Option<f64>,
    /// Passes that are known to have touched it.
    pub passes: u8,
    /// Whether the film broke on it the last time.
    pub failed_at_end: Option<bool>,
}

impl GridPast {
    /// What became of it, in words.
    pub fn words(&self) -> String {
        let first = match (self.failed_first, self.time_to_break_s) {
            (None, _) => "not seen first".to_owned(),
            (Some(false), _) => "passed first".to_owned(),
            (Some(true), None) => "failed first".to_owned(),
            (Some(true), Some(time_s)) => format!("failed first after {} s", fixed(time_s, 1)),
        };
        let passes = match self.passes {
            0 => String::new(),
            1 => ", abraded once".to_owned(),
            passes => format!(", abraded {passes} times"),
        };
        let end = match self.failed_at_end {
            None => ", not seen at the end",
            Some(false) => ", passed at the end",
            Some(true) => ", failed at the end",
        };
        format!("{first}{passes}{end}")
    }
}

/// The row and the column of a grid, from 1; `None` where the name is not that of a grid, such as `r1c1`.
pub fn grid_place(grid: &str) -> Option<(u32, u32)> {
    let (row, column) = grid.strip_prefix('r')?.split_once('c')?;
    Some((row.parse().ok()?, column.parse().ok()?))
}

/// Every grid that the films or the passes tell of. The films are in order, and none is invalid.
pub(super) fn grids(films: &[&Finding], passes: &[Abraded]) -> BTreeMap<String, GridPast> {
    let mut all: BTreeMap<String, GridPast> = BTreeMap::new();
    let mut first = films.first().map(|film| seen_grids(film)).unwrap_or_default();
    for (grid, (failed, broken_mm2)) in std::mem::take(&mut first) {
        let time_to_break_s = films.first().and_then(|film| film.number(&name::failed_after(&grid)));
        let past = all.entry(grid).or_default();
        *past = GridPast { failed_first: Some(failed), time_to_break_s, broken_mm2, ..GridPast::default() };
    }
    for (grid, (failed, _)) in films.last().map(|film| seen_grids(film)).unwrap_or_default() {
        all.entry(grid).or_default().failed_at_end = Some(failed);
    }
    for one in passes.iter().filter(|one| one.how.is_sure()) {
        if let Some(grid) = &one.grid {
            all.entry(grid.clone()).or_default().passes += 1;
        }
    }
    all
}

/// The grids that a film tells of: whether it broke, and on which area, mm².
pub fn seen_grids(film: &Finding) -> BTreeMap<String, (bool, Option<f64>)> {
    let failed = film.names("failed");
    let checks = film.checks.iter().filter_map(|check| {
        let grid = name::grid_of_broken_film(&check.name)?.to_owned();
        let is_failed = failed.contains(&grid);
        // What was not seen says nothing, unless it broke as far as it was seen.
        (check.value.is_some() || is_failed).then_some((grid, (is_failed, check.value)))
    });
    checks.collect()
}
