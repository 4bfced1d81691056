//! The result of each grid: passed at once, failed and passed after it was abraded, failed, or not reported.

use super::numbers::format_with_unit;
use panelprep_cell::record::{CycleRecord, Finding, abraded_grids};
use panelprep_store::history::is_valid_film;
use std::collections::BTreeSet;

/// The result of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridState {
    /// The last valid film does not show the grid as a whole, or there is no valid film.
    NotTested,
    /// The film held.
    Passed,
    /// The film broke, the grid was abraded, and the next film did not break.
    PassedAfterAbrasion,
    /// The film broke.
    Failed,
}

impl GridState {
    /// Every state, in the order of the legend.
    pub const ALL: [GridState; 4] =
        [GridState::Passed, GridState::PassedAfterAbrasion, GridState::Failed, GridState::NotTested];

    /// Returns the letter that identifies the state without colour.
    pub fn state_letter(self) -> &'static str {
        match self {
            GridState::NotTested => "–",
            GridState::Passed => "P",
            GridState::PassedAfterAbrasion => "A",
            GridState::Failed => "F",
        }
    }

    /// Returns the description for people.
    pub fn describe(self) -> &'static str {
        match self {
            GridState::NotTested => "not tested",
            GridState::Passed => "passed",
            GridState::PassedAfterAbrasion => "failed, abraded, then passed",
            GridState::Failed => "failed",
        }
    }

    /// Returns the state's colour: red, green, blue; the letter and the hatch give the same information.
    pub fn state_color(self) -> [u8; 3] {
        match self {
            GridState::NotTested => [255, 255, 255],
            GridState::Passed => [214, 236, 226],
            GridState::PassedAfterAbrasion => [249, 231, 190],
            GridState::Failed => [246, 205, 190],
        }
    }

    /// The directions in which the state's cell is hatched: `[down to the right, up to the right]`.
    pub fn hatch_directions(self) -> [bool; 2] {
        match self {
            GridState::NotTested | GridState::Passed => [false, false],
            GridState::PassedAfterAbrasion => [false, true],
            GridState::Failed => [true, true],
        }
    }
}

/// The region with the state of each grid; `r1c1` is at the top left, as in the taught picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridMap {
    /// Columns.
    pub columns: usize,
    /// Rows of states.
    pub rows: Vec<Vec<GridState>>,
}

/// Returns the name of the grid in this row and column, both counted from 0.
fn name(row: usize, column: usize) -> String {
    format!("r{}c{}", row + 1, column + 1)
}

/// Returns the films that give a result for each grid, in order.
fn films(record: &CycleRecord) -> impl Iterator<Item = &Finding> {
    record.findings.iter().filter(|finding| is_valid_film(finding))
}

/// Returns the broken area of a grid in a film, mm²; `None` if the grid was not wholly seen.
fn broken_mm2(film: &Finding, grid: &str) -> Option<f64> {
    film.number(&format!("broken film in {grid}"))
}

fn is_failed(film: &Finding, grid: &str) -> bool {
    film.names("failed").iter().any(|name| name == grid)
}

fn state(record: &CycleRecord, grid: &str) -> GridState {
    let Some(last) = films(record).last() else { return GridState::NotTested };
    let has_failed = films(record).any(|film| is_failed(film, grid));
    match (is_failed(last, grid), broken_mm2(last, grid), has_failed) {
        (true, ..) => GridState::Failed,
        (false, None, _) => GridState::NotTested,
        (false, Some(_), true) => GridState::PassedAfterAbrasion,
        (false, Some(_), false) => GridState::Passed,
    }
}

/// Creates the map of a region with these numbers of rows and columns.
pub(super) fn map(record: &CycleRecord, rows: usize, columns: usize) -> GridMap {
    let row = |row| (0..columns).map(|column| state(record, &name(row, column))).collect();
    GridMap { columns, rows: (0..rows).map(row).collect() }
}

/// Returns a row for each grid that failed in any film: its name, the film, time to break, broken area, passes, and
/// the area in the last film.
pub(super) fn failed_rows(record: &CycleRecord) -> Vec<Vec<String>> {
    let names: BTreeSet<(usize, usize, String)> = films(record)
        .flat_map(|film| film.names("failed"))
        .map(|grid| {
            let (row, column) = grid.trim_start_matches('r').split_once('c').unwrap_or(("0", "0"));
            (row.parse().unwrap_or(0), column.parse().unwrap_or(0), grid.clone())
        })
        .collect();
    let all = abraded_grids(&record.findings, &record.motions);
    let row = |(_, _, grid): (usize, usize, String)| {
        let first = films(record).find(|film| is_failed(film, &grid));
        let last = films(record).last();
        let area = |film: Option<&Finding>| {
            film.and_then(|film| broken_mm2(film, &grid)).map_or(String::new(), |mm2| format_with_unit(mm2, "mm²"))
        };
        let time = first.and_then(|film| film.number(&format!("{grid} failed after")));
        let passes = all.iter().filter(|one| one.grid.as_deref().is_none_or(|name| name == grid));
        let passes: BTreeSet<u8> = passes.map(|one| one.pass).collect();
        vec![
            grid.clone(),
            first.map_or(String::new(), |film| film_name(film.pass)),
            time.map_or(String::new(), |time_s| format_with_unit(time_s, "s")),
            area(first),
            passes.len().to_string(),
            area(last),
            state(record, &grid).describe().to_owned(),
        ]
    };
    names.into_iter().map(row).collect()
}

/// Returns the name of a film.
pub(super) fn film_name(pass: u8) -> String {
    if pass == 0 { "first".to_owned() } else { format!("after pass {pass}") }
}
