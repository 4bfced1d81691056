//! A day, as calibration files and reports write it.

use panelprep_base::config::Setting;
use panelprep_base::number_text::utc_day;
use toml::de::DeValue;

/// A day, `2026-05-31`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Date(String);

impl Date {
    /// Returns the day that a text names, year first; `None` if it names none.
    pub fn parse(text: &str) -> Option<Self> {
        let day: toml::value::Datetime = text.parse().ok()?;
        (day.date.is_some() && day.time.is_none()).then(|| Date(day.to_string()))
    }

    /// Returns the UTC date of a time.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values from `date -u -d @…`.
    #[test]
    fn days_have_their_dates() {
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
