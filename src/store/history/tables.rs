//! The data of the history as tables for other programs: the columns of each table, and its CSV text, with column names
//! in the first line and all digits of each number.
//!
//! Spreadsheets execute a text that begins like a formula, and a person can enter such a text, for example as a serial
//! number. Therefore an apostrophe is written before such a text; spreadsheets use it to mark a text that is not a
//! formula.

use super::alarms::Alarm;
use super::past_cycle::{Comparison, Summary};
use super::query::Hit;
use super::trend::{HeatMap, Trend};
use panelprep_base::number_text::utc_text;
use panelprep_base::verdict::{Check, Limit, Reason, Verdict};
use panelprep_cell::record::{CycleId, PartNames};

/// The content of a table's cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A missing value.
    Empty,
    /// A text.
    Text(String),
    /// A number, written with the smallest number of digits from which the same value is read back.
    Number(f64),
    /// A count or a time.
    Whole(i64),
    /// A Boolean, written as yes or no.
    Flag(bool),
}

/// A table: column names, which contain the units, and rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The names of the columns.
    pub columns: Vec<String>,
    /// The rows, each with one cell for each column.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Creates a table with these columns and no rows.
    pub fn new(columns: &[&str]) -> Self {
        Table { columns: columns.iter().map(|&name| name.to_owned()).collect(), rows: Vec::new() }
    }

    /// Returns the table with these rows.
    #[must_use]
    pub fn with_rows(self, rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        Table { rows: rows.into_iter().collect(), ..self }
    }

    /// Returns the table as CSV (RFC 4180) in UTF-8.
    ///
    /// # Errors
    /// If the number of cells in a row differs from the number of columns.
    pub fn csv(&self) -> Result<String, csv::Error> {
        let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row.iter().map(Cell::text))?;
        }
        let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
        // The bytes are valid UTF-8, because only texts were written.
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Empty => String::new(),
            Cell::Text(text) if text.starts_with(['=', '+', '-', '@', '\t', '\r']) => format!("'{text}"),
            Cell::Text(text) => text.clone(),
            Cell::Number(number) => panelprep_base::number_text::shortest_text(*number),
            Cell::Whole(number) => number.to_string(),
            Cell::Flag(flag) => flag.to_string(),
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        Cell::Number(number)
    }
}

impl From<i64> for Cell {
    fn from(number: i64) -> Self {
        Cell::Whole(number)
    }
}

impl From<usize> for Cell {
    fn from(number: usize) -> Self {
        Cell::Whole(i64::try_from(number).unwrap_or(i64::MAX))
    }
}

impl From<bool> for Cell {
    fn from(flag: bool) -> Self {
        Cell::Flag(flag)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Cell::Empty, Into::into)
    }
}

/// The first columns of a row about a cycle, up to the codes of its reasons.
const CYCLE_COLUMNS: [&str; 11] = [
    "cycle",
    "started_utc",
    "started_unix_s",
    "ended_unix_s",
    "panel",
    "serial",
    "order",
    "operator",
    "verdict",
    "is_air_run",
    "codes",
];

/// Returns the first cells of a row about a cycle, for `CYCLE_COLUMNS`.
fn cycle_cells(
    (cycle, panel): (CycleId, &str),
    (started_unix_s, ended_unix_s): (i64, Option<i64>),
    part: &PartNames,
    (verdict, is_air_run): (Option<Verdict>, bool),
) -> Vec<Cell> {
    vec![
        cycle.0.into(),
        utc_text(started_unix_s).into(),
        started_unix_s.into(),
        ended_unix_s.into(),
        panel.into(),
        part.serial.clone().into(),
        part.order.clone().into(),
        part.operator.clone().into(),
        verdict.map(Verdict::keyword).into(),
        is_air_run.into(),
    ]
}

/// Returns the table of the cycles that a search has found.
pub fn hits_table(hits: &[Hit]) -> Table {
    Table::new(&[&CYCLE_COLUMNS[..], &["reasons"]].concat()).with_rows(hits.iter().map(|hit| {
        let times_unix_s = (hit.started_unix_s, hit.ended_unix_s);
        let mut row = cycle_cells((hit.cycle, &hit.panel), times_unix_s, &hit.part, (hit.verdict, hit.is_air_run));
        row.extend([codes(&hit.reasons).into(), join_messages(&hit.reasons).into()]);
        row
    }))
}

fn codes(reasons: &[Reason]) -> String {
    reasons.iter().map(|reason| &*reason.code).collect::<Vec<_>>().join(" ")
}

fn join_messages(reasons: &[Reason]) -> String {
    reasons.iter().map(|reason| reason.message.as_str()).collect::<Vec<_>>().join("; ")
}

/// Returns the table of summaries, with one cycle in each row.
pub fn summary_table(summaries: &[Summary]) -> Table {
    let columns = [
        "passes",
        "films_valid",
        "films_invalid",
        "films_watched_s",
        "grids",
        "grids_failed_first",
        "grids_failed_at_end",
        "localization_residual_mm",
        "localization_residual_limit_mm",
        "outline_residual_px",
        "localization_error_mm",
        "localization_error_limit_mm",
        "error_at_tool_mm",
        "cycle_time_s",
        "simulated_s",
        "disc_swept_mm2",
        "disc_worn_mm2",
    ];
    Table::new(&[&CYCLE_COLUMNS[..], &columns].concat()).with_rows(summaries.iter().map(summary_row))
}

fn summary_row(summary: &Summary) -> Vec<Cell> {
    let value = |check: &Option<Check>| Cell::from(check.as_ref().and_then(|check| check.value));
    let limit = |check: &Option<Check>| Cell::from(check.as_ref().and_then(|check| check.limit.value()));
    let grids = |grids: &Option<Vec<String>>| Cell::from(grids.as_ref().map(|grids| grids.join(" ")));
    let times_unix_s = (summary.started_unix_s, summary.ended_unix_s);
    let (about, end) = ((summary.cycle, summary.panel.as_str()), (summary.verdict, summary.is_air_run));
    let mut row = cycle_cells(about, times_unix_s, &summary.part, end);
    row.extend([
        codes(&summary.reasons).into(),
        i64::from(summary.passes).into(),
        summary.films.valid.into(),
        summary.films.invalid.into(),
        summary.films.watched_s.into(),
        summary.films.grids.into(),
        grids(&summary.films.failed_first),
        grids(&summary.films.failed_at_end),
        value(&summary.localization_residual),
        limit(&summary.localization_residual),
        value(&summary.outline_residual),
        value(&summary.localization_error),
        limit(&summary.localization_error),
        summary.budget_total_mm.into(),
        summary.cycle_time_s.into(),
        summary.simulated_s.into(),
        summary.disc.map(|disc| disc.swept_mm2).into(),
        summary.disc.map(|disc| disc.worn_mm2).into(),
    ]);
    row
}

/// Returns the table of a comparison of two cycles. It contains inputs, checks and grids; the first column states the
/// kind of the row.
pub fn comparison_table(comparison: &Comparison) -> Table {
    let columns =
        ["what", "phase", "pass", "name", "unit", "first", "second", "difference", "limit_first", "limit_second"];
    let plain = |what: &str, name: &str, values: [Cell; 2], difference: Cell| {
        let [first, second] = values;
        let empty = || Cell::Empty;
        vec![what.into(), empty(), empty(), name.into(), empty(), first, second, difference, empty(), empty()]
    };
    let inputs = comparison.inputs.iter().map(|input| {
        let difference = if input.is_same { "same" } else { "differs" };
        plain("input", &input.name, input.values.clone().map(Cell::from), difference.into())
    });
    let checks = comparison.checks.iter().map(|pair| {
        let [first, second] = pair.values.map(Cell::from);
        let [limit_first, limit_second] = pair.limits.map(|limit| limit.map_or(Cell::Empty, limit_cell));
        let (phase, pass) = (pair.kind.keyword().into(), i64::from(pair.pass).into());
        let (name, unit) = (pair.name.as_str().into(), pair.unit.as_str().into());
        vec![
            "check".into(),
            phase,
            pass,
            name,
            unit,
            first,
            second,
            pair.difference.into(),
            limit_first,
            limit_second,
        ]
    });
    let grids = comparison.grids.iter().map(|pair| {
        let words =
            pair.cycles.each_ref().map(|past| past.as_ref().map_or(Cell::Empty, |past| past.describe().into()));
        let is_same = pair.cycles[0] == pair.cycles[1];
        plain("grid", &pair.grid, words, if is_same { "same" } else { "differs" }.into())
    });
    Table::new(&columns).with_rows(inputs.chain(checks).chain(grids))
}

fn limit_cell(limit: Limit) -> Cell {
    match limit {
        Limit::Unlimited => Cell::Empty,
        Limit::AtMost(bound) => format!("at most {}", panelprep_base::number_text::shortest_text(bound)).into(),
        Limit::AtLeast(bound) => format!("at least {}", panelprep_base::number_text::shortest_text(bound)).into(),
        Limit::Below(bound) => format!("below {}", panelprep_base::number_text::shortest_text(bound)).into(),
    }
}

/// Returns the table of a trend, with the hints in the rows of their values.
pub fn trend_table(trend: &Trend) -> Table {
    let value = match trend.unit.as_str() {
        "" => "value".to_owned(),
        unit => format!("value [{unit}]"),
    };
    let columns = ["cycle", "at_utc", "at_unix_s", "serial", &value, "limit", "hints"];
    Table::new(&columns).with_rows(trend.points.iter().enumerate().map(|(at, point)| {
        let hints = trend.hints.iter().filter(|hint| hint.at == at).map(|hint| hint.rule.describe());
        vec![
            point.cycle.map(|cycle| cycle.0).into(),
            utc_text(point.at_unix_s).into(),
            point.at_unix_s.into(),
            point.serial.clone().into(),
            point.value.into(),
            limit_cell(point.limit),
            hints.collect::<Vec<_>>().join("; ").into(),
        ]
    }))
}

/// Returns the table of all grids over many cycles.
pub fn heat_table(map: &HeatMap) -> Table {
    let columns = ["grid", "row", "column", "films", "breaks", "median_time_to_break_s"];
    Table::new(&columns).with_rows(map.grids.iter().map(|cell| {
        vec![
            cell.grid.as_str().into(),
            i64::from(cell.row).into(),
            i64::from(cell.column).into(),
            cell.films.into(),
            cell.breaks.into(),
            cell.median_s.into(),
        ]
    }))
}

/// Returns the table of alarms, with times, cause and remedy of each alarm.
pub fn alarm_table(alarms: &[Alarm]) -> Table {
    let columns = [
        "raised_utc",
        "raised_unix_ms",
        "gone_unix_ms",
        "priority",
        "code",
        "cycle",
        "phase",
        "message",
        "cause",
        "remedy",
        "acknowledged_by",
        "acknowledged_unix_ms",
    ];
    Table::new(&columns).with_rows(alarms.iter().map(|alarm| {
        vec![
            utc_text(alarm.raised_unix_ms.div_euclid(1_000)).into(),
            alarm.raised_unix_ms.into(),
            alarm.gone_unix_ms.into(),
            alarm.priority.keyword().into(),
            alarm.code.as_str().into(),
            alarm.cycle.map(|cycle| cycle.0).into(),
            alarm.phase.map(|kind| kind.keyword()).into(),
            alarm.message.as_str().into(),
            alarm.cause.as_str().into(),
            alarm.remedy.as_str().into(),
            alarm.acknowledged.as_ref().map(|seen| seen.who.as_str()).into(),
            alarm.acknowledged.as_ref().map(|seen| seen.unix_ms).into(),
        ]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_reads_back_from_csv_and_contains_no_formula() {
        let row =
            vec![Cell::from("=HYPERLINK(\"x\")"), Cell::from(0.1 + 0.2), Cell::Empty, Cell::from("a, \"b\"\nc")];
        let table = Table::new(&["serial", "residual_mm", "error_mm", "reason"]).with_rows([row]);
        let text = table.csv().expect("written");
        assert_eq!(
            text,
            "serial,residual_mm,error_mm,reason\r\n\"'=HYPERLINK(\"\"x\"\")\",0.30000000000000004,,\"a, \"\"b\"\"\nc\"\r\n"
        );
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let read = reader.records().next().expect("a row").expect("CSV");
        assert_eq!(read.get(1).and_then(|cell| cell.parse().ok()), Some(0.1 + 0.2));
        assert!(Table::new(&["a", "b"]).with_rows([vec![Cell::Empty]]).csv().is_err(), "a row that is too short");
    }
}
