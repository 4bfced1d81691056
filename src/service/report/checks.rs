//! Checks as rows of a page: the number with its unit, its limit, and the source of the limit.

use super::page::Row;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals, shortest_text};
use panelprep_base::verdict::{Check, Limit, LimitSource};

pub(super) const NOT_MEASURED_TEXT: &str = "not measured";

/// Returns a check as a row; `beside` is written after its value. A limit without a key is the program's own.
pub fn check_row(check: &Check, beside: &str) -> Row {
    let with_unit = |text: String| format!("{text} {}", check.unit).trim_end().to_owned();
    let (sign, limit) = match check.limit {
        Limit::Unlimited => ("", None),
        Limit::AtMost(limit) => ("≤ ", Some(limit)),
        Limit::AtLeast(limit) => ("≥ ", Some(limit)),
        Limit::Below(limit) => ("< ", Some(limit)),
    };
    let (mut value, mut allowed) = (check.value.map(format_value), limit.map(format_value));
    let is_beyond = !check.is_met();
    if let (true, Some(found), Some(limit)) = (is_beyond && value == allowed, check.value, limit) {
        let [found, limit] = distinguishable_texts(found, limit, decimals(limit));
        (value, allowed) = (Some(found), Some(limit));
    }
    let value = match value {
        None => NOT_MEASURED_TEXT.to_owned(),
        Some(value) if is_beyond => format!("{}{beside}, outside of the limit", with_unit(value)),
        Some(value) => format!("{}{beside}", with_unit(value)),
    };
    let set_by = match &check.set_by {
        Some(LimitSource::Recipe(key)) => format!(" (recipe, {key})"),
        Some(LimitSource::Cell(key)) => format!(" (cell, {key})"),
        Some(LimitSource::Program) | None => String::new(),
    };
    let allowed = allowed.map_or(String::new(), |limit| format!("{sign}{}{set_by}", with_unit(limit)));
    Row::new(&check.name, value, allowed)
}

/// Formats a value with four significant digits, or with all digits before the point; the store has the full value.
pub fn format_value(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || value.fract() == 0.0 {
        return shortest_text(value);
    }
    let text = fixed_decimals(value, decimals(value)).to_string();
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Returns the number of digits after the point that gives four significant digits.
fn decimals(value: f64) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_states_whose_limit_it_is() {
        let check = Check::new("residual", "mm", 0.3);
        let of_recipe = check.clone().with_max(0.25, LimitSource::recipe("locate.max_rms_mm"));
        let row = check_row(&of_recipe, "");
        assert_eq!(
            (&*row.value, &*row.allowed),
            ("0.3 mm, outside of the limit", "≤ 0.25 mm (recipe, locate.max_rms_mm)")
        );
        assert_eq!(check_row(&check.with_max(0.25, LimitSource::Program), "").allowed, "≤ 0.25 mm");
    }
}
