//! The data from which the sheet is created, the tables of the sheet and of its annex, and the map of the grids.
//!
//! The result of a grid is one of: passed in the first film, passed after it had failed and was sanded, failed, not
//! tested. All numbers have one format: the digits that the measurement supports, beside the limit and its source.

use crate::report::cycle::event_sections;
use crate::report::page::Section;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::Verdict;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{
    Check, CycleRecord, Disposition, Finding, Kind, Limit, LimitSource, PartNames, abraded_grids,
    finding_dispositions, name,
};
use panelprep_store::history::is_valid_film;
use panelprep_store::signing::StatedValues;
use std::collections::BTreeSet;

/// The data from which the sheet is created.
#[derive(Debug, Clone, Copy)]
pub struct RecordSources<'s> {
    /// The cycle.
    pub record: &'s CycleRecord,
    /// The part of the cycle; `None` if no part was named.
    pub part: Option<&'s PartNames>,
    /// The recipe of the cycle; `None` if the stored copy is missing.
    pub recipe: Option<&'s Recipe>,
    /// Text that states who approved the recipe and when; `None` if the store contains no approval of this recipe's
    /// text.
    pub recipe_approval: Option<&'s str>,
    /// The equipment.
    pub equipment: &'s [Equipment],
    /// Earlier cycles that sanded the same part; `None` if the part's serial number is not known.
    pub earlier: Option<&'s [EarlierCycle]>,
    /// The people who signed, in the order of their signatures.
    pub signatures: &'s [PrintedSignature],
}

/// A camera, a tool or a mount, with its calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// The kind of equipment, such as "scanner, lens".
    pub what: String,
    /// The serial number of the equipment; `None` if its calibration contains none.
    pub serial: Option<String>,
    /// The day of the calibration.
    pub calibrated: Option<String>,
    /// SHA-256 of the calibration file.
    pub hash: String,
    /// The last verification before the cycle; `None` if there is none.
    pub verified: Option<LastVerification>,
}

/// A verification against a known target, as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LastVerification {
    /// The day.
    pub day: String,
    /// The measured error and the limit.
    pub error: String,
}

/// An earlier cycle that sanded the same part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EarlierCycle {
    /// Its number.
    pub cycle: i64,
    /// Start of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// Its passes.
    pub passes: usize,
}

/// A signature in its printed form.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrintedSignature {
    /// The printed name.
    pub name: String,
    /// The time.
    pub time: String,
    /// The meaning of the signature, such as "reviewed".
    pub meaning: String,
    /// The record's number in the chain of signed records, and the hash of the record.
    pub chain_position: String,
    /// Whether the person decided with this signature about the release of the part.
    pub is_deciding: bool,
    /// The values that the cell does not measure, as this person stated them.
    pub values: StatedValues,
}

/// A table with its heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Its heading.
    pub heading: String,
    /// The headings of the columns, each with the column's fraction of the width.
    pub columns: Vec<(&'static str, f32)>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

const CHECK_COLUMNS: [(&str, f32); 4] =
    [("check", 0.42), ("measured", 0.2), ("limit", 0.18), ("limit set by", 0.2)];

/// Lists every film, including invalid films.
pub(super) fn film_list(record: &CycleRecord) -> Block {
    let films = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let attempt = |film: &Finding| {
        let failed = film.names("failed");
        let watched = film.checks.iter().find(|check| check.name == name::WATCHED_TIME_NAME);
        let reasons: Vec<&str> = film.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        vec![
            film_name(film.pass),
            film.judgement.verdict.keyword().to_owned(),
            watched.map_or(String::new(), |check| row(check, "")[1].clone()),
            if failed.is_empty() { "none".to_owned() } else { shorten_for_page(&failed.join(", "), 45) },
            shorten_for_page(&reasons.join("; "), 75),
        ]
    };
    Block {
        heading: "All observed films".to_owned(),
        columns: vec![
            ("film", 0.12),
            ("verdict", 0.09),
            ("watched", 0.09),
            ("grids that failed", 0.26),
            ("reasons", 0.44),
        ],
        rows: films.map(attempt).collect(),
    }
}

/// Lists the values by which a reader evaluates the treatment; if a value was measured several times, only the last
/// one.
pub(super) fn value_list(record: &CycleRecord) -> Block {
    // In the record, the names of some checks are understandable only after the preceding check. Here each name is
    // complete.
    let wanted = [
        (Kind::Inspect, name::SMALLEST_BREAK, name::SMALLEST_BREAK),
        (Kind::Locate, name::RESIDUAL, name::RESIDUAL),
        (Kind::Plan, name::COVERAGE, "coverage, worst grid"),
        (Kind::Abrade, name::REMOVED_BOUND, "removed depth over all passes, deepest place, 95 %"),
        (Kind::Abrade, name::REMOVED_MEAN, "removed depth on the treated grids, mean"),
        (Kind::Plan, name::REMOVED_EVEN, "planned removal, deviation from the target"),
        (Kind::Plan, name::DWELL_RATIO, "ratio of longest to shortest dwell time"),
        (Kind::Plan, name::WORN_BY_A_GRID, name::WORN_BY_A_GRID),
        (Kind::Abrade, name::PATH_DEVIATION_NAME, "largest distance of a reported pose from the path"),
        (Kind::Reach, name::PROFILE_FROM_DRAWING, name::PROFILE_FROM_DRAWING),
        (Kind::Reach, name::PROFILE, name::PROFILE),
        (Kind::Reach, name::PROFILE_UNCERTAINTY, name::PROFILE_UNCERTAINTY),
        (Kind::Reach, name::FLATNESS, name::FLATNESS),
        (Kind::Reach, name::FLATNESS_UNCERTAINTY, name::FLATNESS_UNCERTAINTY),
    ];
    let last = |(kind, name, label): (Kind, &str, &str)| {
        let findings = record.findings.iter().rev().filter(|finding| finding.kind == kind);
        let mut checks =
            findings.filter_map(|finding| Some((finding, finding.checks.iter().find(|it| it.name == name)?)));
        let (finding, check) = checks.next()?;
        let of = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        let mut row = row(check, "");
        row[0] = format!("{label} ({}{of})", kind_text(kind));
        Some(row)
    };
    Block {
        heading: "Measured values with their limits".to_owned(),
        columns: CHECK_COLUMNS.to_vec(),
        rows: wanted.into_iter().filter_map(last).collect(),
    }
}

fn kind_text(kind: Kind) -> &'static str {
    match kind {
        Kind::Locate => "localization",
        Kind::Refine => "corner",
        Kind::Reach => "reach",
        Kind::Inspect => "film",
        Kind::Plan => "path",
        Kind::Verify => "corner before contact",
        Kind::Abrade => "abrasion",
        Kind::Gate => "checks before a motion",
        Kind::Robot => "robot",
        Kind::SelfTest => "self-test",
        Kind::Tool => "compliant tool",
    }
}

pub(super) fn equipment_table(all: &[Equipment]) -> Block {
    let line = |one: &Equipment| {
        let verified = one.verified.as_ref();
        vec![
            one.what.clone(),
            one.serial.clone().unwrap_or_else(|| "not named".to_owned()),
            one.calibrated.clone().unwrap_or_else(|| "not dated".to_owned()),
            verified.map_or("not verified".to_owned(), |last| format!("{}, {}", last.day, last.error)),
            short_hash(&one.hash),
        ]
    };
    Block {
        heading: "Equipment".to_owned(),
        columns: vec![
            ("what", 0.24),
            ("serial number", 0.16),
            ("calibrated", 0.14),
            ("last verification", 0.28),
            ("SHA-256", 0.18),
        ],
        rows: all.iter().map(line).collect(),
    }
}

/// Lists the results about which a person had to decide, each with the decision.
pub(super) fn deviation_list(record: &CycleRecord) -> Block {
    let all = record.findings.iter().zip(finding_dispositions(&record.findings, &record.asked));
    let reviews = all.filter(|(finding, _)| finding.judgement.verdict == Verdict::Review);
    let review = |(finding, disposition): (&Finding, Disposition<'_>)| {
        let reasons: Vec<&str> = finding.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        let decision = disposition.describe().unwrap_or_else(|| "no person decided".to_owned());
        [
            vec![format!("review: {}{pass}", kind_text(finding.kind)), shorten_for_page(&reasons.join("; "), 100)],
            vec!["decision".to_owned(), decision],
        ]
    };
    Block {
        heading: "Deviations, and who accepted them".to_owned(),
        columns: vec![("what", 0.22), ("reasons or decision", 0.78)],
        rows: reviews.flat_map(review).collect(),
    }
}

pub(super) fn signatures(sources: &RecordSources<'_>) -> Block {
    let mut rows: Vec<Vec<String>> = sources
        .signatures
        .iter()
        .map(|one| vec![one.name.clone(), one.time.clone(), one.meaning.clone(), one.chain_position.clone()])
        .collect();
    if sources.signatures.is_empty() {
        rows.push(vec!["the cell".to_owned(), String::new(), "not signed yet".to_owned(), String::new()]);
    }
    Block {
        heading: "Signatures".to_owned(),
        columns: vec![("name", 0.24), ("time", 0.22), ("meaning", 0.24), ("record", 0.3)],
        rows,
    }
}

/// Returns the line for a handwritten signature; `None` if the cycle examined no part, so that there is nothing to
/// release, or if a signature already contains the decision.
pub(super) fn signature_line(sources: &RecordSources<'_>) -> Option<Vec<String>> {
    let is_open = sources.record.has_examined_part() && !sources.signatures.iter().any(|one| one.is_deciding);
    let line = "……………………………".to_owned();
    is_open.then(|| vec![line.clone(), line.clone(), "released / not released".to_owned(), line])
}

/// Lists the sanded grids, and every request to the cell with its author and result: holds, a new disc, decisions. The
/// sections are those of the cycle's page.
pub(super) fn event_list(record: &CycleRecord) -> Vec<Block> {
    let block = |section: Section| {
        let text = vec![String::new(), section.text];
        let rows = section.rows.into_iter().map(|row| vec![row.name, row.value]);
        Block {
            heading: section.heading,
            columns: vec![("what", 0.22), ("words", 0.78)],
            rows: std::iter::once(text).chain(rows).collect(),
        }
    };
    event_sections(record).into_iter().map(block).collect()
}

/// Lists every reason in full length, because the page has space only for short ones.
pub(super) fn reason_list(record: &CycleRecord) -> Option<Block> {
    let row = |what: String, verdict: Verdict, message: &str| {
        vec![what, verdict.keyword().to_owned(), message.to_owned()]
    };
    let of_cycle = record.judgement.iter().flat_map(|judgement| {
        judgement.reasons.iter().map(|reason| row("the cycle".to_owned(), judgement.verdict, &reason.message))
    });
    let of_findings = record.findings.iter().flat_map(|finding| {
        let what = format!("{}, pass {}", kind_text(finding.kind), finding.pass);
        let judgement = &finding.judgement;
        judgement.reasons.iter().map(move |reason| row(what.clone(), judgement.verdict, &reason.message))
    });
    let rows: Vec<Vec<String>> = of_cycle.chain(of_findings).collect();
    let columns = vec![("finding", 0.22), ("verdict", 0.1), ("reason", 0.68)];
    (!rows.is_empty()).then(|| Block { heading: "All reasons".to_owned(), columns, rows })
}

pub(super) fn check_table(finding: &Finding) -> Block {
    let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
    Block {
        heading: format!("All numbers: {}{pass}, {}", kind_text(finding.kind), finding.judgement.verdict.keyword()),
        columns: CHECK_COLUMNS.to_vec(),
        rows: finding.checks.iter().map(|check| row(check, "")).collect(),
    }
}

/// Shortens a text to at most this number of characters for the page; the annex contains the full text.
pub(super) fn shorten_for_page(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}… (see the annex)", &text[..end]),
        None => text.to_owned(),
    }
}

/// Returns the first digits of a hash, which are sufficient to compare two printed hashes; the signed record contains
/// all digits.
pub(super) fn short_hash(hash: &str) -> String {
    hash.get(..16).map_or(hash.to_owned(), |digits| format!("{digits}…"))
}

/// The result of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridState {
    /// The last valid film does not show the whole grid, or there is no valid film.
    NotTested,
    /// The film held.
    Passed,
    /// The film broke, the grid was sanded, and the next film did not break.
    PassedAfterAbrasion,
    /// The film broke.
    Failed,
}

impl GridState {
    /// All states, in the order of the legend.
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
            GridState::PassedAfterAbrasion => "failed, sanded, then passed",
            GridState::Failed => "failed",
        }
    }

    /// Returns the state's colour: red, green, blue; the letter and the hatch contain the same information.
    pub fn state_color(self) -> [u8; 3] {
        match self {
            GridState::NotTested => [255, 255, 255],
            GridState::Passed => [214, 236, 226],
            GridState::PassedAfterAbrasion => [249, 231, 190],
            GridState::Failed => [246, 205, 190],
        }
    }

    /// Returns the directions in which the state's cell is hatched: `[down to the right, up to the right]`.
    pub fn hatch_directions(self) -> [bool; 2] {
        match self {
            GridState::NotTested | GridState::Passed => [false, false],
            GridState::PassedAfterAbrasion => [false, true],
            GridState::Failed => [true, true],
        }
    }
}

/// The region with the state of each grid; `r1c1` is at the upper left, as in the taught picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridMap {
    /// Columns.
    pub columns: usize,
    /// Rows of states.
    pub rows: Vec<Vec<GridState>>,
}

/// Returns the name of the grid in this row and column, both counted from 0.
fn grid_name(row: usize, column: usize) -> String {
    format!("r{}c{}", row + 1, column + 1)
}

/// Returns the valid films in order; only these contain a result for each grid.
fn films(record: &CycleRecord) -> impl Iterator<Item = &Finding> {
    record.findings.iter().filter(|finding| is_valid_film(finding))
}

/// Returns the broken area of a grid in a film, mm²; `None` if the grid was not completely visible.
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
    let row = |row| (0..columns).map(|column| state(record, &grid_name(row, column))).collect();
    GridMap { columns, rows: (0..rows).map(row).collect() }
}

/// Returns a row for each grid that failed in any film: name, first film in which it failed, time to break, broken
/// area, number of passes, area in the last film, and result.
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

/// Returns the printed name of a film.
fn film_name(pass: u8) -> String {
    if pass == 0 { "first".to_owned() } else { format!("after pass {pass}") }
}

/// Returns the number of decimals that the measurements of a unit support: pictures are 0.2 s apart, a pixel covers a
/// few tenths of a millimetre, and calibrations are accurate to hundredths of a millimetre.
fn decimals(value: f64, unit: &str) -> usize {
    match unit {
        "mm" | "px" => 2,
        "s" | "%" | "°" => 1,
        "mm²" if value.abs() < 10.0 => 1,
        "mm²" | "grey levels" | "ms" => 0,
        _ if value.fract() == 0.0 => 0,
        _ => 2,
    }
}

/// Returns the number of decimals with which a stated number is printed exactly, at most 4.
fn exact_decimals(value: f64) -> usize {
    let shows = |digits: &usize| {
        let scaled = value * 10_f64.powi(*digits as i32);
        (scaled - scaled.round()).abs() < 1e-6
    };
    (0..4).find(shows).unwrap_or(4)
}

/// Formats a number with its unit.
fn format_with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", fixed_decimals(value, decimals(value, unit))).trim_end().to_owned()
}

/// Formats an uncertainty with two significant digits and its unit.
pub(super) fn format_uncertainty(value: f64, unit: &str) -> String {
    let digits = if value > 0.0 { (1 - value.log10().floor() as i32).clamp(0, 4) as usize } else { 2 };
    format!("{} {unit}", fixed_decimals(value, digits))
}

/// Returns the number of decimals, at least `decimals` and at most 4, with which a value other than zero is not printed
/// as zero.
fn nonzero_decimals(value: f64, decimals: usize) -> usize {
    let looks_zero = |digits: usize| (value * 10_f64.powi(digits as i32)).round() == 0.0;
    if value == 0.0 { decimals } else { (decimals..4).find(|digits| !looks_zero(*digits)).unwrap_or(4) }
}

/// Formats a check as a row of the table of values: name, measured value, limit, source of the limit. If there is no
/// value, its column contains "not measured", and the limit is still stated.
pub(super) fn row(check: &Check, of: &str) -> Vec<String> {
    let what = format!("{}{of}", check.name);
    let (sign, bound) = match check.limit {
        Limit::Unlimited => ("", None),
        Limit::AtMost(limit) => ("≤ ", Some(limit)),
        Limit::AtLeast(limit) => ("≥ ", Some(limit)),
        Limit::Below(limit) => ("< ", Some(limit)),
    };
    // The value and the limit are printed with the same number of decimals: beside a limit of 0.99, a fraction of 1 is
    // printed as 1.00. A limit is a stated number and is never rounded.
    let of_bound = |bound: f64| decimals(bound, &check.unit).max(exact_decimals(bound));
    let of_value = |value: f64| nonzero_decimals(value, decimals(value, &check.unit));
    let decimals = check.value.map_or(0, of_value).max(bound.map_or(0, of_bound));
    let unit = |number: String| format!("{number} {}", check.unit).trim_end().to_owned();
    let shown = |value: f64| unit(fixed_decimals(value, decimals).to_string());
    let mut found = check.value.map_or("not measured".to_owned(), shown);
    let mut allowed = bound.map(shown).unwrap_or_default();
    if let (false, Some(value), Some(bound)) = (check.is_met(), check.value, bound) {
        let [number, limit] = distinguishable_texts(value, bound, decimals);
        (found, allowed) = (format!("{}, outside of the limit", unit(number)), unit(limit));
    }
    let by = match &check.set_by {
        _ if bound.is_none() => String::new(),
        Some(LimitSource::Recipe(key)) => format!("recipe, {key}"),
        Some(LimitSource::Cell(key)) => format!("cell, {key}"),
        Some(LimitSource::Program) | None => "program".to_owned(),
    };
    vec![what, found, if allowed.is_empty() { String::new() } else { format!("{sign}{allowed}") }, by]
}
