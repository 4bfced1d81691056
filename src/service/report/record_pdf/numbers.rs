//! The numbers of the page in one format: with the digits that the measurement supports, beside the limit and its
//! source.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_cell::record::{Check, Limit, LimitSource};

/// Returns the number of digits after the point that the measurements of a unit support: a picture every fifth of a
/// second, a pixel of a few tenths of a millimetre, a calibration of hundredths.
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

/// Returns the number of digits after the point that show a stated number as it is, at most 4.
fn exact_decimals(value: f64) -> usize {
    let shows = |digits: &usize| {
        let scaled = value * 10_f64.powi(*digits as i32);
        (scaled - scaled.round()).abs() < 1e-6
    };
    (0..4).find(shows).unwrap_or(4)
}

/// Formats a number with its unit.
pub(super) fn format_with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", fixed_decimals(value, decimals(value, unit))).trim_end().to_owned()
}

/// Returns an uncertainty with its two significant digits.
pub(super) fn uncertainty(value: f64, unit: &str) -> String {
    let digits = if value > 0.0 { (1 - value.log10().floor() as i32).clamp(0, 4) as usize } else { 2 };
    format!("{} {unit}", fixed_decimals(value, digits))
}

/// Returns the number of digits after the point, at least `decimals`, with which a value does not look like zero; at
/// most 4.
fn nonzero_decimals(value: f64, decimals: usize) -> usize {
    let looks_zero = |digits: usize| (value * 10_f64.powi(digits as i32)).round() == 0.0;
    if value == 0.0 { decimals } else { (decimals..4).find(|digits| !looks_zero(*digits)).unwrap_or(4) }
}

/// Formats a check as a row of the table of numbers: name, found value, limit, source of the limit. A value that was
/// not measured is said to be so in its own column, beside the limit.
pub(super) fn row(check: &Check, of: &str) -> Vec<String> {
    let what = format!("{}{of}", check.name);
    let (sign, bound) = match check.limit {
        Limit::Unlimited => ("", None),
        Limit::AtMost(limit) => ("≤ ", Some(limit)),
        Limit::AtLeast(limit) => ("≥ ", Some(limit)),
        Limit::Below(limit) => ("< ", Some(limit)),
    };
    // The value and the limit have the same format: a share of 1 beside a limit of 0.99 is 1.00. A limit is a stated
    // number and is never rounded.
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
