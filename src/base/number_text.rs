//! Formats of numbers and times in sentences for people.
//!
//! A measured value and the limit that it violates are printed such that the two texts differ. A number that rounds to
//! zero is printed without a sign. A NaN is printed as such.

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::Offset;
use std::fmt::{self, Display, Formatter};

/// Maximum number of decimals; further decimals of a double carry no information.
const MAX_DECIMALS: usize = 15;

/// Checks a name or a remark that a page shows unchanged.
///
/// # Errors
/// If the text is empty, longer than this number of characters, or contains characters that cannot be printed.
pub fn check_printable(text: &str, most_characters: usize) -> Result<(), String> {
    match text.chars().count() {
        _ if text.trim() != text || text.is_empty() => {
            Err("the text is empty, or begins or ends with a space".to_owned())
        }
        count if count > most_characters => Err(format!("the text is longer than {most_characters} characters")),
        _ if text.chars().any(char::is_control) => {
            Err("the text contains control characters, such as a line feed".to_owned())
        }
        _ => Ok(()),
    }
}

/// A number with a given number of decimals, without a sign if it rounds to zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedDecimals {
    value: f64,
    decimals: usize,
}

/// Returns a number with this number of decimals: see [`FixedDecimals`].
pub fn fixed_decimals(value: f64, decimals: usize) -> FixedDecimals {
    FixedDecimals { value, decimals }
}

impl Display for FixedDecimals {
    /// The width of the format is applied, right-aligned as for numbers.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let text = text(self.value, self.decimals);
        let width = f.width().unwrap_or(0);
        write!(f, "{text:>width$}")
    }
}

fn text(value: f64, decimals: usize) -> String {
    if value.is_nan() {
        return "unknown".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { "infinite" } else { "minus infinite" }.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        _ => text,
    }
}

/// Returns the shortest text that reads back as the same number, without a sign if the number is zero.
pub fn shortest_text(value: f64) -> String {
    if !value.is_finite() {
        return text(value, 0);
    }
    // Adding zero changes a negative zero to zero.
    (value + 0.0).to_string()
}

/// Returns the measured value and the limit that it violates, as texts that differ: with `decimals` decimals, and with
/// more if the two texts would be equal. The limit has no trailing zeros.
pub fn distinguishable_texts(found: f64, limit: f64, decimals: usize) -> [String; 2] {
    let at = |decimals: usize| [text(found, decimals), text(limit, decimals)];
    let differ = |decimals: &usize| {
        let [found, limit] = at(*decimals);
        found != limit
    };
    let enough = (decimals..=MAX_DECIMALS).find(differ).unwrap_or(decimals);
    let [found_text, limit_text] = at(enough);
    [found_text, trim_zeros(&limit_text).to_owned()]
}

/// Returns numbers in brackets, each as the shortest text that reads back as the same number.
pub fn list(numbers: &[f64]) -> String {
    format!("[{}]", numbers.iter().map(|number| shortest_text(*number)).collect::<Vec<_>>().join(", "))
}

/// Returns two fractions 0…1 in percent, as [`distinguishable_texts`] does.
pub fn distinguishable_percents(found: f64, limit: f64, decimals: usize) -> [String; 2] {
    distinguishable_texts(100.0 * found, 100.0 * limit, decimals)
}

/// Returns the UTC day of a time in seconds since 1970: `2026-05-31`.
pub fn utc_day(unix_s: i64) -> String {
    civil_time(unix_s).date().to_string()
}

/// Returns UTC date and time of a time in seconds since 1970: `2026-05-31 09:00:00 UTC`.
pub fn utc_text(unix_s: i64) -> String {
    let time = civil_time(unix_s);
    format!("{} {} UTC", time.date(), time.time())
}

/// Converts to a calendar time. Times beyond the years ±9999 are limited to the last or first possible time.
fn civil_time(unix_s: i64) -> DateTime {
    let beyond = if unix_s < 0 { Timestamp::MIN } else { Timestamp::MAX };
    Offset::UTC.to_datetime(Timestamp::from_second(unix_s).unwrap_or(beyond))
}

/// Removes trailing zeros after the decimal point.
fn trim_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_rounded_zero_has_no_sign() {
        for (value, decimals, words) in
            [(-0.04, 1, "0.0"), (-0.4, 0, "0"), (-0.06, 1, "-0.1"), (0.0, 3, "0.000"), (-12.0, 1, "-12.0")]
        {
            assert_eq!(fixed_decimals(value, decimals).to_string(), words);
        }
        assert_eq!(format!("{:8}|", fixed_decimals(-1.25, 2)), "   -1.25|");
        assert_eq!(
            (shortest_text(-0.0), shortest_text(0.5), shortest_text(f64::NAN)),
            ("0".into(), "0.5".into(), "unknown".into())
        );
    }

    #[test]
    fn nan_is_named_as_such() {
        assert_eq!(fixed_decimals(f64::NAN, 3).to_string(), "unknown");
        assert_eq!(distinguishable_texts(f64::INFINITY, 0.1, 3), ["infinite", "0.1"]);
        assert_eq!(distinguishable_texts(f64::NAN, 0.25, 3), ["unknown", "0.25"]);
    }

    /// Expected values, determined by hand: 8.2 % and 8 % differ with one decimal, 0.5004 and 0.5 with four.
    #[test]
    fn a_value_and_its_violated_limit_are_distinguishable() {
        assert_eq!(distinguishable_percents(0.082, 0.08, 0), ["8.2", "8"]);
        assert_eq!(distinguishable_texts(0.5004, 0.5, 2), ["0.5004", "0.5"]);
        assert_eq!(distinguishable_texts(0.75, 0.25, 3), ["0.750", "0.25"]);
        assert_eq!(distinguishable_texts(60.1, 60.0, 1), ["60.1", "60"]);
        assert_eq!(distinguishable_texts(12.0, 100.0, 0), ["12", "100"]);
        assert_eq!(distinguishable_texts(0.5, 0.5, 1), ["0.5", "0.5"], "the limit itself, where it is not allowed");
    }

    /// Expected values from `date -u -d @…`: leap days, also in a century year that is a leap year, and the last second
    /// before 1970.
    #[test]
    fn times_are_formatted_as_calendar_dates() {
        for (unix_s, words) in [
            (-1, "1969-12-31 23:59:59 UTC"),
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_709_251_199, "2024-02-29 23:59:59 UTC"),
            (1_795_297_432, "2026-11-21 21:43:52 UTC"),
        ] {
            assert_eq!(utc_text(unix_s), words);
            assert_eq!(Some(utc_day(unix_s).as_str()), words.split(' ').next());
        }
        assert!(utc_text(i64::MAX).starts_with("9999-12-3"), "{}", utc_text(i64::MAX));
    }

    proptest! {
        #[test]
        fn two_numbers_are_distinguished(found in -1e6_f64..1e6, step in prop::num::f64::POSITIVE, decimals in 0_usize..4) {
            let limit = found + step.clamp(1e-9, 1e3);
            let [found_text, limit_text] = distinguishable_texts(found, limit, decimals);
            prop_assert!(trim_zeros(&found_text) != limit_text, "{found_text} {limit_text}");
            let read: f64 = found_text.parse().expect("a number");
            prop_assert!((read - found).abs() <= 0.5 / 10_f64.powi(decimals as i32) + 1e-9);
            let is_zero = |text: &str| text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
            for text in [found_text, limit_text] {
                prop_assert!(!(text.starts_with('-') && is_zero(&text)), "{text}");
            }
        }
    }
}
