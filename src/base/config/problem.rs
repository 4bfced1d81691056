//! The problems of a configuration file: the line of a key or of a syntax error, and the known name that the user most
//! probably meant.

use toml::de::{DeTable, DeValue};

/// One problem of a file: its line and key, the value found, and the valid values.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// Line in the file, from 1; also 1 if the problem concerns the whole file.
    pub line: usize,
    /// The key with its tables, such as `locate.max_shift_mm`; empty if the problem concerns the whole file.
    pub key: String,
    /// The value that was found, the valid values, and what to do.
    pub message: String,
}

/// All problems of one file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Problems {
    /// The file's name as the user wrote it.
    pub file: String,
    /// The problems, in the order of their lines.
    pub list: Vec<Problem>,
}

impl std::fmt::Display for Problems {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, problem) in self.list.iter().enumerate() {
            let (end_of_last, colon) =
                (if index > 0 { "\n" } else { "" }, if problem.key.is_empty() { "" } else { ": " });
            write!(f, "{end_of_last}{}:{}: {}{colon}{}", self.file, problem.line, problem.key, problem.message)?;
        }
        Ok(())
    }
}

/// Converts a syntax error to a problem.
pub(super) fn syntax_problem(text: &str, error: &toml::de::Error) -> Problem {
    let offset = error.span().map_or(0, |span| span.start);
    let line = line_number(text, offset);
    let message = match text.lines().nth(line - 1).and_then(find_decimal_comma) {
        Some((found, meant)) => format!("found {found}; a number has a decimal point: write {meant}"),
        None => format!("not TOML: {}", error.message()),
    };
    Problem { line, key: find_key_at(text, line).unwrap_or_default(), message }
}

/// Returns the line of a key, `poses.park.a1_deg`. If the key does not exist, the line of its table, or 1.
pub fn key_line(text: &str, key: &str) -> usize {
    let (root, _) = DeTable::parse_recoverable(text);
    let (mut table, mut line) = (Some(root.get_ref()), 1);
    for part in key.split('.') {
        let Some((name, value)) = table.and_then(|table| table.get_key_value(part)) else { break };
        line = line_number(text, name.span().start);
        table = match value.get_ref() {
            DeValue::Table(inner) => Some(inner),
            _ => None,
        };
    }
    line
}

/// Returns the line, from 1, of a byte offset in the text.
pub(super) fn line_number(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// Finds a number with a decimal comma in this line, `6,5`; returns it and the same number with a point.
fn find_decimal_comma(line: &str) -> Option<(String, String)> {
    let values = line.split('=').skip(1);
    values
        .filter_map(|value| {
            let value = value.trim_start();
            let number: String = value.chars().take_while(|c| c.is_ascii_digit() || "+-,_.".contains(*c)).collect();
            let (whole, fraction) = number.trim_end_matches(',').split_once(',')?;
            let is_whole =
                whole.trim_start_matches(['+', '-']).chars().all(|c| c.is_ascii_digit()) && !whole.is_empty();
            let is_fraction = !fraction.is_empty() && fraction.chars().all(|c| c.is_ascii_digit());
            (is_whole && is_fraction).then(|| (format!("{whole},{fraction}"), format!("{whole}.{fraction}")))
        })
        .next()
}

/// Returns the key at the start of a line, with the last table header above the line. The key is read from the text,
/// because the parsed tree does not contain broken or duplicate keys.
fn find_key_at(text: &str, line: usize) -> Option<String> {
    let header = |line: &str| Some(line.trim().strip_prefix('[')?.trim_matches(['[', ']', ' ']).to_owned());
    let written = text.lines().nth(line - 1)?;
    if let Some(table) = header(written) {
        return Some(table);
    }
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    let key = written.split(['=', ' ']).find(|word| !word.is_empty())?.trim();
    let table = text.lines().take(line - 1).filter_map(header).last();
    key.chars().all(is_plain).then(|| table.map_or(key.to_owned(), |table| format!("{table}.{key}")))
}

/// Units at the end of a key, each with its quantity in words. Longer endings come first, because `_mm_s` also ends in
/// `_s`.
const UNITS: [(&str, &str); 24] = [
    ("_mm_min", "this speed is in mm/min"),
    ("_m_min", "this speed is in m/min"),
    ("_mm_s", "this speed is in mm/s"),
    ("_cm_s", "this speed is in cm/s"),
    ("_m_s", "this speed is in m/s"),
    ("_deg_s", "this angular speed is in degrees/s"),
    ("_rad_s", "this angular speed is in radians/s"),
    ("_percent", "this fraction is in percent"),
    ("_inch", "this length is in inches"),
    ("_rad", "this angle is in radians"),
    ("_deg", "this angle is in degrees"),
    ("_mm2", "this area is in mm²"),
    ("_cm2", "this area is in cm²"),
    ("_min", "this time is in minutes"),
    ("_px2", "this area is in px²"),
    ("_mm", "this length is in mm"),
    ("_cm", "this length is in cm"),
    ("_um", "this length is in µm"),
    ("_px", "this length is in px"),
    ("_ms", "this time is in ms"),
    ("_in", "this length is in inches"),
    ("_m", "this length is in m"),
    ("_s", "this time is in seconds"),
    ("_h", "this time is in hours"),
];

/// Minimum similarity of two names, 0…1, at which one is proposed instead of the other.
const MIN_SIMILARITY: f64 = 0.8;

fn stem_and_unit(key: &str) -> (&str, Option<&'static str>) {
    let split = |(unit, rule): &(&str, &'static str)| key.strip_suffix(unit).map(|stem| (stem, Some(*rule)));
    UNITS.iter().find_map(split).unwrap_or((key, None))
}

/// Returns the known name that the user most probably meant. If the two names differ only in their unit, also the unit
/// of the known name.
pub fn nearest<'k>(unknown: &str, known: &[&'k str]) -> Option<(&'k str, Option<&'static str>)> {
    let written = unknown.to_lowercase().replace(['-', ' '], "_");
    let (stem, unit) = stem_and_unit(&written);
    let same_but_unit = known.iter().find_map(|&name| {
        let (name_stem, rule) = stem_and_unit(name);
        let same_stem = name_stem == stem && unit.is_some() || name_stem == written;
        (rule.is_some() && name != written && same_stem).then_some((name, rule))
    });
    let closeness = |name: &str| strsim::jaro_winkler(&written, name);
    let alike = || known.iter().copied().max_by(|a, b| closeness(a).total_cmp(&closeness(b)));
    same_but_unit.or_else(|| alike().filter(|name| closeness(name) > MIN_SIMILARITY).map(|name| (name, None)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_a_key_or_of_its_table_is_found() {
        let text = "store = 'a'\n\n[poses]\npark = { a1_deg = 1.0 }\n[poses.ready]\na1_deg = 2.0\n[io.outputs]\nlight = 1\n";
        for (key, line) in [
            ("store", 1),
            ("poses.park.a1_deg", 4),
            ("poses.ready.a1_deg", 6),
            ("poses.ready.a2_deg", 5),
            ("io.outputs.spray", 7),
            ("limits.box_min_mm", 1),
        ] {
            assert_eq!(key_line(text, key), line, "{key}");
        }
    }

    #[test]
    fn a_wrong_unit_is_distinguished_from_a_misspelling() {
        let known =
            ["max_shift_mm", "turn_limit_deg", "heartbeat_ms", "token_s", "feed_mm_s", "min_break_mm2", "rows"];
        for (written, name, unit) in [
            ("max_shift_cm", "max_shift_mm", Some("this length is in mm")),
            ("max_shift", "max_shift_mm", Some("this length is in mm")),
            ("turn_limit_rad", "turn_limit_deg", Some("this angle is in degrees")),
            ("heartbeat_s", "heartbeat_ms", Some("this time is in ms")),
            ("token_ms", "token_s", Some("this time is in seconds")),
            ("feed_m_s", "feed_mm_s", Some("this speed is in mm/s")),
            ("min_break_mm", "min_break_mm2", Some("this area is in mm²")),
            ("max-shift-mm", "max_shift_mm", None),
            ("Rows", "rows", None),
            ("rwos", "rows", None),
            ("max_shfit_mm", "max_shift_mm", None),
        ] {
            assert_eq!(nearest(written, &known), Some((name, unit)), "{written}");
        }
        assert_eq!(nearest("wavelength", &known), None);
        assert_eq!(nearest("", &known), None);
    }
}
