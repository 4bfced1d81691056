//! Finds the line of a syntax error.

use super::problem::Problem;

/// The line of an offset, from 1.
pub(super) fn line_number(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// Converts a syntax error to a problem.
pub(super) fn syntax_problem(text: &str, error: &toml::de::Error) -> Problem {
    let offset = error.span().map_or(0, |span| span.start);
    let line = line_number(text, offset);
    let message = match text.lines().nth(line - 1).and_then(decimal_comma) {
        Some((found, meant)) => format!("found {found}; a number has a decimal point: write {meant}"),
        None => format!("not TOML: {}", error.message()),
    };
    Problem { line, key: key_at(text, line).unwrap_or_default(), message }
}

/// Finds a number with a decimal comma in this line, `6,5`; returns it and the same number with a point.
fn decimal_comma(line: &str) -> Option<(String, String)> {
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

/// The key at the start of a line, under the last table header above it. The parsed tree cannot state this: it does
/// not contain broken or duplicate keys.
fn key_at(text: &str, line: usize) -> Option<String> {
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
