//! The table of `tests/bench/README.md` as text: its rows, the figures of a row, and the page with newly measured
//! figures.
//!
//! A row contains one or more figures of one area. They are separated by "·", in the same order in each cell: `area: a
//! · b` is the figures `area: a` and `area: b`. A cell with a single part applies to all figures of the row.

use std::collections::BTreeMap;

/// The first line of the table.
pub const HEAD: &str = "| Figure | Goal | Measured | Command | Commit |";

/// Separates the figures of a row.
const BETWEEN: &str = " · ";

/// Description of the fields of a `GOAL` line, for its error message.
const FIELDS: &str = "GOAL, figure, goal, found, ok|MISSED|not run and command, separated by tabs";

/// A figure as a bench reported it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Measured {
    pub figure: String,
    pub goal: String,
    /// The measured value, with the verdict if the goal was missed.
    pub found: String,
    pub command: String,
}

/// Returns the figures in a bench's output. Other lines are skipped.
///
/// # Errors
///
/// If a `GOAL` line cannot be read, or contains text that is not permitted in a cell of the table. The error contains
/// the line's number.
pub fn parse(output: &str) -> Result<Vec<Measured>, String> {
    let lines = output.lines().enumerate().filter(|(_, line)| line.starts_with("GOAL\t"));
    let one = |(index, line): (usize, &str)| {
        let wrong = |what: String| format!("line {}: {what}; expected are {FIELDS}: {line}", index + 1);
        let fields: Vec<&str> = line.split('\t').collect();
        let [_, figure, goal, found, state, command] = fields[..] else {
            return Err(wrong(format!("{} fields", fields.len())));
        };
        if let Some(field) = fields.iter().find(|field| field.trim().is_empty() || field.contains(['|', '·'])) {
            return Err(wrong(format!("the field \"{field}\" is empty or contains | or ·")));
        }
        let found = match state {
            "ok" => found.to_owned(),
            "not run" => "not run".to_owned(),
            "MISSED" => format!("{found}: **missed**"),
            other => return Err(wrong(format!("the state \"{other}\""))),
        };
        let [figure, goal, command] = [figure, goal, command].map(str::to_owned);
        Ok(Measured { figure, goal, found, command: format!("`{command}`") })
    };
    lines.map(one).collect()
}

/// Returns the rows of the page's table as text.
pub fn rows(page: &str) -> Vec<&str> {
    page.lines().skip_while(|line| *line != HEAD).skip(2).take_while(|line| line.starts_with('|')).collect()
}

fn cells(row: &str) -> Vec<&str> {
    row.trim_matches('|').split(" | ").map(str::trim).collect()
}

/// Returns the names of the figures of a row.
pub fn figures(row: &str) -> Vec<String> {
    let name = cells(row).first().copied().unwrap_or_default();
    let (area, names) = name.split_once(": ").unwrap_or(("", name));
    names.split(BETWEEN).map(|name| format!("{area}: {name}")).collect()
}

/// Returns the part of each figure in a cell. An error if the number of parts is neither one nor `count`.
fn parts(cell: &str, count: usize) -> Result<Vec<String>, String> {
    let parts: Vec<String> = cell.split(BETWEEN).map(str::to_owned).collect();
    match parts.len() {
        1 => Ok(vec![parts[0].clone(); count]),
        found if found == count => Ok(parts),
        found => Err(format!("\"{cell}\" has {found} parts for {count} figures")),
    }
}

/// Returns a cell with these parts; equal parts are written once.
fn joined(parts: &[String]) -> String {
    let all_equal = parts.iter().all(|part| *part == parts[0]);
    if all_equal { parts[0].clone() } else { parts.join(BETWEEN) }
}

/// Returns a row with the figures that were measured at this commit; `None` if none of its figures was measured.
fn renewed(row: &str, measured: &BTreeMap<&str, &Measured>, commit: &str) -> Result<Option<String>, String> {
    let figures = figures(row);
    if !figures.iter().any(|figure| measured.contains_key(figure.as_str())) {
        return Ok(None);
    }
    let cells = cells(row);
    let [name, rest @ ..] = &cells[..] else { return Err(format!("no row: {row}")) };
    let rest: Result<Vec<_>, String> = rest.iter().map(|cell| parts(cell, figures.len())).collect();
    let rest = rest.map_err(|what| format!("the row \"{name}\": {what}"))?;
    let Ok([mut goals, mut founds, mut commands, mut commits]) = <[Vec<String>; 4]>::try_from(rest) else {
        return Err(format!("the row \"{name}\" has {} cells instead of 5", cells.len()));
    };
    for (index, figure) in figures.iter().enumerate() {
        let Some(new) = measured.get(figure.as_str()) else { continue };
        goals[index].clone_from(&new.goal);
        founds[index].clone_from(&new.found);
        commands[index].clone_from(&new.command);
        commits[index] = format!("`{commit}`");
    }
    // These cells keep one part per figure, because two figures may have the same value by chance.
    let (goals, founds) = (goals.join(BETWEEN), founds.join(BETWEEN));
    Ok(Some(format!("| {name} | {goals} | {founds} | {} | {} |", joined(&commands), joined(&commits))))
}

/// Returns the page with the newly measured figures. Rows of other figures keep their values and their commit. If a
/// figure was reported more than once, its last report is used.
///
/// # Errors
///
/// If a row cannot be read, or a figure has no row. Nothing is written then, so that no figure is lost unnoticed.
pub fn replaced(page: &str, measured: &[Measured], commit: &str) -> Result<String, String> {
    let by_name: BTreeMap<&str, &Measured> = measured.iter().map(|one| (one.figure.as_str(), one)).collect();
    let table = rows(page);
    let known: Vec<String> = table.iter().flat_map(|row| figures(row)).collect();
    let unknown: Vec<&&str> = by_name.keys().filter(|name| !known.iter().any(|known| known == *name)).collect();
    if !unknown.is_empty() {
        return Err(format!("no row of the table has these figures: {unknown:?}. Add a row, or correct the name."));
    }
    let mut renewed_page = String::new();
    for line in page.lines() {
        let new = if table.contains(&line) { renewed(line, &by_name, commit)? } else { None };
        renewed_page.push_str(new.as_deref().unwrap_or(line));
        renewed_page.push('\n');
    }
    Ok(renewed_page)
}
