//! The origin of a calibration: its date, the program, the pictures, and the residual of each picture.
//!
//! It also contains the size of the board to which a file refers: a verification with a board of another size would
//! find another position.

use panelprep_base::config::{Section, Setting};
use panelprep_base::number_text::utc_day;
use std::fmt::Write;
use std::ops::RangeInclusive;
use toml::de::DeValue;

/// A calendar date, such as `2026-05-31`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Date(String);

impl Date {
    /// Parses a date in the form year-month-day; `None` if the text is not a date.
    pub fn parse(text: &str) -> Option<Self> {
        let day: toml::value::Datetime = text.parse().ok()?;
        (day.date.is_some() && day.time.is_none()).then(|| Date(day.to_string()))
    }

    /// Returns the UTC date of a Unix time.
    pub fn from_unix_s(unix_s: i64) -> Self {
        Date(utc_day(unix_s))
    }
}

impl std::fmt::Display for Date {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl Setting for Date {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let text = match value {
            DeValue::Datetime(day) => day.to_string(),
            DeValue::String(text) => text.to_string(),
            _ => String::new(),
        };
        Date::parse(&text).ok_or_else(|| "valid: a date, such as 2026-05-31".to_owned())
    }
}

/// The origin of a calibration; every key may be absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// The name and version of the program that wrote the file.
    pub program: Option<String>,
    /// SHA-256 of each picture or points file that was used.
    pub pictures: Vec<String>,
    /// The residual of each picture or points file, in the order of `pictures`: px for intrinsics, mm for a mount.
    pub residuals: Vec<f64>,
}

impl Provenance {
    pub(super) fn parse(section: &Section<'_, '_>, residuals: &'static str) -> Option<Self> {
        let program = section.parse("program", (), Some(None));
        let pictures = section.parse("pictures", (), Some(TextList::default()));
        let residuals = section.parse(residuals, (), Some(Numbers::default()));
        Some(Provenance { program: program?, pictures: pictures?.0, residuals: residuals?.0 })
    }

    pub(super) fn write(&self, text: &mut String, residuals: &str) {
        line(text, "program", self.program.as_ref().map(|program| toml::Value::from(program.as_str())));
        if !self.pictures.is_empty() {
            line(text, "pictures", Some(toml::Value::from(self.pictures.clone())));
        }
        if !self.residuals.is_empty() {
            line(text, residuals, Some(format!("{:?}", self.residuals)));
        }
    }
}

/// A list of texts.
#[derive(Default)]
pub(super) struct TextList(pub(super) Vec<String>);

impl Setting for TextList {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().map(|list| list.iter().map(|item| String::parse(item.get_ref(), &())));
        let list = list.ok_or_else(|| "valid: a list of texts".to_owned())?;
        list.collect::<Result<_, _>>().map(TextList)
    }
}

/// A list of residuals.
#[derive(Default)]
struct Numbers(Vec<f64>);

impl Setting for Numbers {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().map(|list| list.iter().map(|item| f64::parse(item.get_ref(), &RESIDUALS)));
        let list = list.ok_or_else(|| "valid: a list of numbers".to_owned())?;
        list.collect::<Result<_, _>>().map(Numbers)
    }
}

/// The valid range of a residual: the residual of an excluded picture may be large.
const RESIDUALS: RangeInclusive<f64> = 0.0..=100_000.0;

pub(super) fn line(text: &mut String, key: &str, value: Option<impl std::fmt::Display>) {
    if let Some(value) = value {
        #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
        let _ = writeln!(text, "{key} = {value}");
    }
}

const SQUARE_MM: std::ops::RangeInclusive<f64> = 0.5..=500.0;

/// A calibration board, in the notation of the command line.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSize {
    /// The board's corners or squares, `9x6` or `charuco:8x6:15:4X4_50`.
    pub board: String,
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl std::fmt::Display for BoardSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "--board {} --square-mm {}", self.board, self.square_mm)
    }
}

impl BoardSize {
    pub(super) fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let (board, square_mm) = (section.parse("board", (), None), section.parse("square_mm", SQUARE_MM, None));
        Some(BoardSize { board: board?, square_mm: square_mm? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values: the output of `date -u -d @…`.
    #[test]
    fn seconds_since_1970_are_converted_to_dates() {
        for (unix_s, expected) in [
            (-1, "1969-12-31"),
            (0, "1970-01-01"),
            (951_782_400, "2000-02-29"),
            (1_709_251_199, "2024-02-29"),
            (1_795_297_432, "2026-11-21"),
        ] {
            assert_eq!(Some(Date::from_unix_s(unix_s)), Date::parse(expected));
        }
    }
}
