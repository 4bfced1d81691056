//! Reads the table of coupons, a CSV file with one measurement per line; columns are found by their names, in any
//! order.
//!
//! Every problem is reported with its line and column; a table with a problem is not used.

use super::coupons::{Coupon, Lines};
use csv::{ReaderBuilder, StringRecord, Trim};
use panelprep_base::number_text::shortest_text;
use std::ops::RangeInclusive;

/// A column of numbers: its name, the range of its values, and whether each line must have a value.
type Column = (&'static str, RangeInclusive<f64>, bool);

/// Minimum depth that can be measured, µm.
const MIN_DEPTH_UM: f64 = 0.01;
const COLUMNS: [Column; 8] = [
    ("force_n", 0.1..=1_000.0, true),
    ("feed_mm_s", 0.1..=1_000.0, true),
    ("passes", 1.0..=10_000.0, true),
    ("worn_mm2", 0.0..=1e9, true),
    ("step_over_mm", 0.1..=500.0, false),
    ("depth_um", MIN_DEPTH_UM..=10_000.0, false),
    ("before_um", 0.0..=1e6, false),
    ("after_um", 0.0..=1e6, false),
];
const COUPON: &str = "coupon";
const PLACE_COLUMN: &str = "place";
const DISC: &str = "disc";
/// First character of a comment line.
const REMARK_SIGN: char = '#';

/// All problems of a table.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
pub struct TableError(pub Vec<TableProblem>);

/// One problem of a table.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, {column}: {message}")]
pub struct TableProblem {
    /// Number of the line, from 1.
    pub line: u64,
    /// Name of the column.
    pub column: String,
    /// The value that was found, and the valid values.
    pub message: String,
}

fn problem(line: u64, column: &str, message: impl Into<String>) -> TableProblem {
    TableProblem { line, column: column.to_owned(), message: message.into() }
}

/// Reads a table of coupons.
///
/// # Errors
/// If the table has problems: all of them, with line and column.
pub fn read_coupons(bytes: &[u8]) -> Result<Vec<Coupon>, TableError> {
    let text = String::from_utf8(bytes.to_vec()).map_err(|error| {
        let line = 1 + bytes[..error.utf8_error().valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        TableError(vec![problem(line as u64, "the line", "the file is not UTF-8 text")])
    })?;
    let lines = text.trim_start_matches('\u{feff}').lines().zip(1_u64..);
    let mut lines =
        lines.filter(|(text, _)| !text.trim().is_empty() && !text.trim_start().starts_with(REMARK_SIGN));
    let (header, line) = lines.next().unwrap_or(("", 1));
    let header = split_line(header);
    let of_header = header_problems(&header, line);
    if !of_header.is_empty() {
        return Err(TableError(of_header));
    }
    let (mut problems, mut coupons) = (Vec::new(), Vec::new());
    for (text, line) in lines {
        match coupon(&Row { header: &header, record: &split_line(text), line }) {
            Ok(coupon) => coupons.push(coupon),
            Err(found) => problems.extend(found),
        }
    }
    if problems.is_empty() { Ok(coupons) } else { Err(TableError(problems)) }
}

/// Splits one line of the table into its values.
fn split_line(line: &str) -> StringRecord {
    let mut reader = ReaderBuilder::new().has_headers(false).trim(Trim::All).from_reader(line.as_bytes());
    // Reading from memory cannot fail.
    reader.records().next().and_then(Result::ok).unwrap_or_default()
}

fn header_problems(header: &StringRecord, line: u64) -> Vec<TableProblem> {
    let known = || COLUMNS.iter().map(|(name, ..)| *name).chain([COUPON, PLACE_COLUMN, DISC]);
    let has = |name: &str| header.iter().any(|found| found == name);
    let unknown = header.iter().filter(|found| !known().any(|name| name == *found));
    let names = known().collect::<Vec<_>>().join(", ");
    let mut problems: Vec<TableProblem> =
        unknown.map(|found| problem(line, found, format!("unknown column; valid: {names}"))).collect();
    let needed = COLUMNS.iter().filter(|(.., needed)| *needed).map(|(name, ..)| *name).chain([COUPON]);
    problems.extend(needed.filter(|name| !has(name)).map(|name| problem(line, name, "this column is missing")));
    if !(has("depth_um") || has("before_um") && has("after_um")) {
        problems.push(problem(line, "depth_um", "this column is missing; before_um and after_um can replace it"));
    }
    let twice =
        header.iter().enumerate().filter(|(index, name)| header.iter().take(*index).any(|other| other == *name));
    problems.extend(twice.map(|(_, name)| problem(line, name, "this column appears twice")));
    problems
}

/// A line of the table, with the table's header.
struct Row<'a> {
    header: &'a StringRecord,
    record: &'a StringRecord,
    line: u64,
}

impl Row<'_> {
    fn text(&self, column: &str) -> Option<&str> {
        let index = self.header.iter().position(|name| name == column)?;
        self.record.get(index).filter(|text| !text.is_empty())
    }

    fn number(&self, (name, allowed, needed): &Column) -> Result<Option<f64>, TableProblem> {
        let Some(text) = self.text(name) else {
            return if *needed { Err(problem(self.line, name, "the number is missing")) } else { Ok(None) };
        };
        let number = text.parse::<f64>().ok().filter(|number| allowed.contains(number));
        let [low, high] = [allowed.start(), allowed.end()].map(|end| shortest_text(*end));
        let message = || format!("found {text}, valid: a number from {low} to {high}");
        number.map(Some).ok_or_else(|| problem(self.line, name, message()))
    }
}

fn coupon(row: &Row<'_>) -> Result<Coupon, Vec<TableProblem>> {
    let mut problems = Vec::new();
    if row.record.len() != row.header.len() {
        let message = format!(
            "{} values, but {} are needed, one for each column of the header",
            row.record.len(),
            row.header.len()
        );
        return Err(vec![problem(row.line, "the line", message)]);
    }
    let numbers: Vec<Option<f64>> = COLUMNS
        .iter()
        .map(|column| {
            row.number(column).unwrap_or_else(|found| {
                problems.push(found);
                None
            })
        })
        .collect();
    if row.text(COUPON).is_none() {
        problems.push(problem(row.line, COUPON, "the name is missing"));
    }
    // If only some lines name their disc, the scatter between discs would be wrong.
    if row.header.iter().any(|name| name == DISC) && row.text(DISC).is_none() {
        problems.push(problem(row.line, DISC, "the name is missing"));
    }
    let is_whole = numbers[2].is_none_or(|passes| passes.fract() == 0.0);
    if !is_whole {
        problems.push(problem(row.line, "passes", "must be a whole number"));
    }
    let depth_um = if problems.is_empty() { depth_um(row, &numbers[5..]) } else { Err(Vec::new()) };
    match (&numbers[..5], row.text(COUPON), depth_um) {
        ([Some(force_n), Some(feed_mm_s), Some(passes), Some(worn_mm2), apart_mm], Some(name), Ok(depth_um)) => {
            let name = row.text(PLACE_COLUMN).map_or_else(|| name.to_owned(), |place| format!("{name} {place}"));
            Ok(Coupon {
                line: row.line,
                name,
                disc: row.text(DISC).map(str::to_owned),
                force_n: *force_n,
                feed_mm_s: *feed_mm_s,
                passes: *passes,
                lines: apart_mm.map_or(Lines::One, Lines::Rows),
                worn_mm2: *worn_mm2,
                depth_um,
            })
        }
        (_, _, found) => Err(problems.into_iter().chain(found.err().into_iter().flatten()).collect()),
    }
}

/// Returns the depth of a line: its depth column, or the difference of its two thicknesses.
fn depth_um(row: &Row<'_>, numbers: &[Option<f64>]) -> Result<f64, Vec<TableProblem>> {
    match numbers {
        [Some(depth_um), None, None] => Ok(*depth_um),
        [None, Some(before_um), Some(after_um)] if before_um - after_um >= MIN_DEPTH_UM => Ok(before_um - after_um),
        [None, Some(before_um), Some(after_um)] => Err(vec![problem(
            row.line,
            "after_um",
            format!(
                "found {}, must be less than before_um, {}",
                shortest_text(*after_um),
                shortest_text(*before_um)
            ),
        )]),
        [Some(_), ..] => {
            Err(vec![problem(row.line, "depth_um", "state either a depth, or before_um and after_um, not both")])
        }
        _ => {
            Err(vec![problem(row.line, "depth_um", "the number is missing; before_um and after_um can replace it")])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str =
        "coupon,place,force_n,feed_mm_s,passes,step_over_mm,worn_mm2,depth_um,before_um,after_um\n";

    fn problems(text: &str) -> Vec<String> {
        let error = read_coupons(text.as_bytes()).expect_err("refused");
        error.to_string().lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_table_is_read() {
        let text =
            format!("{HEADER}# measured on Monday\nA1,middle,20,60,2,,0,14.9,,\nA1,left,20,60,4,12,1e5,,88.5,30\n");
        let read = read_coupons(text.as_bytes()).unwrap_or_else(|error| panic!("{error}"));
        let [first, second] = &read[..] else { panic!("{read:?}") };
        assert_eq!(
            (first.name.as_str(), first.line, first.lines, first.depth_um),
            ("A1 middle", 3, Lines::One, 14.9)
        );
        assert_eq!((second.worn_mm2, second.lines, second.depth_um), (1e5, Lines::Rows(12.0), 58.5));
        let short = "worn_mm2,coupon,passes,force_n,feed_mm_s,depth_um\n0,A1,1,20,60,15\n";
        assert_eq!(read_coupons(short.as_bytes()).expect("read")[0].name, "A1");
        assert_eq!(read_coupons(short.as_bytes()).expect("read")[0].disc, None);
        let discs = "worn_mm2,coupon,disc,passes,force_n,feed_mm_s,depth_um\n0,A1,D7,1,20,60,15\n";
        assert_eq!(read_coupons(discs.as_bytes()).expect("read")[0].disc.as_deref(), Some("D7"));
        assert_eq!(problems(&discs.replace("D7", "")), ["line 2, disc: the name is missing"]);
    }

    #[test]
    fn each_mistake_is_reported_with_line_and_column() {
        let line = |values: &str| problems(&format!("{HEADER}{values}\n"));
        assert_eq!(
            line("A1,,-20,60,1.5,,0,14.9,,"),
            [
                "line 2, force_n: found -20, valid: a number from 0.1 to 1000",
                "line 2, passes: must be a whole number"
            ]
        );
        assert_eq!(line("A1,,20,60,1,,0,-3,,"), ["line 2, depth_um: found -3, valid: a number from 0.01 to 10000"]);
        assert_eq!(line("A1,,20,60,1,,0,,80,80").len(), 1, "nothing is gone");
        assert_eq!(line("A1,,20,60,1,,0,,80,81"), ["line 2, after_um: found 81, must be less than before_um, 80"]);
        assert_eq!(
            line("A1,,20,60,1,,0,3,80,81"),
            ["line 2, depth_um: state either a depth, or before_um and after_um, not both"]
        );
        assert_eq!(line("A1,,20,,1,,NaN,3,,")[0], "line 2, feed_mm_s: the number is missing");
        assert_eq!(line(",,20,60,1,,0,3,,"), ["line 2, coupon: the name is missing"]);
        assert_eq!(
            line("A1,20"),
            ["line 2, the line: 2 values, but 10 are needed, one for each column of the header"]
        );
        assert_eq!(
            line("A1,,20,60,1,,0,,80,"),
            ["line 2, depth_um: the number is missing; before_um and after_um can replace it"]
        );
    }

    #[test]
    fn unknown_or_missing_columns_are_named() {
        let found = problems("coupon,force,feed_mm_s,passes,worn_mm2,depth_um\nA1,20,60,1,0,15\n");
        assert!(found[0].starts_with("line 1, force: unknown column; valid: force_n, feed_mm_s,"), "{found:?}");
        assert_eq!(found[1..], ["line 1, force_n: this column is missing"]);
        assert_eq!(
            problems("")[..2],
            ["line 1, force_n: this column is missing", "line 1, feed_mm_s: this column is missing"]
        );
        assert!(read_coupons(b"coupon\n\xff\xfe").is_err());
    }
}
