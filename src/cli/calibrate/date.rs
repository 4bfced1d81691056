//! Today, for calibration files.

use crate::cell::Date;
use std::time::{SystemTime, UNIX_EPOCH};

/// Seconds since 1970.
pub fn now_unix_s() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs() as i64)
}

/// The day in UTC.
pub fn today() -> Option<Date> {
    Date::parse(&day(now_unix_s()))
}

/// The day of a time, year first: days are counted from 1 March, so that a leap day ends the year (Hinnant,
/// "chrono-compatible low-level date algorithms").
pub fn day(unix_s: i64) -> String {
    let days = unix_s.div_euclid(86_400) + 719_468;
    let (era, of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From `date -u -d @…`.
    #[test]
    fn days_have_their_dates() {
        for (unix_s, expected) in [
            (0, "1970-01-01"),
            (951_782_400, "2000-02-29"),
            (1_709_251_199, "2024-02-29"),
            (1_795_297_432, "2026-11-21"),
        ] {
            assert_eq!(day(unix_s), expected);
        }
        assert!(today().is_some());
    }
}
