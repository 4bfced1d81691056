//! Reads the clock for calibration files.

use panelprep_cell::cell::Date;
use std::time::{SystemTime, UNIX_EPOCH};

/// Seconds since 1970.
pub fn now_unix_s() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs() as i64)
}

/// Returns today's date in UTC.
pub fn today_utc() -> Option<Date> {
    Some(Date::from_unix_s(now_unix_s()))
}
