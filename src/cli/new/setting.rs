//! Sets values in a sample's text, and finds the problems of these values there.

use super::questions::Refusal;
use panelprep_base::config::{Problem, set_value};
use panelprep_base::number_text::shortest_text;
use toml_edit::{DocumentMut, Value};

/// Sets a value in a file's text, in an existing table; the comment next to it stays.
pub(super) fn set(document: &mut DocumentMut, table: &str, key: &str, value: impl Into<Value>) {
    let mut below = table.split('.').filter(|name| !name.is_empty());
    let home = below.try_fold(document.as_table_mut(), |home, name| home.get_mut(name)?.as_table_mut());
    if let Some(home) = home {
        set_value(home, key, value);
    }
}

/// Returns the first problem at a key that begins with `keys`, as a refusal.
pub(super) fn refusal(problems: Vec<Problem>, keys: &str) -> Refusal {
    let first = problems.into_iter().find(|problem| problem.key.starts_with(keys));
    first.map_or(Ok(()), |Problem { key, message, .. }| Err(format!("{key}: {message}")))
}

/// Formats numbers in the form of an answer.
pub(super) fn format_numbers(numbers: &[f64]) -> String {
    numbers.iter().copied().map(shortest_text).collect::<Vec<_>>().join(",")
}
