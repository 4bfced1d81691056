//! The wall-clock time.

use std::time::{SystemTime, UNIX_EPOCH};

/// Returns the time since 1970, ns; 0 if the clock is set to a time before 1970.
pub fn now_unix_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or_default()
}

/// Returns the time since 1970, ms.
pub fn now_unix_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// Returns the time since 1970, s.
pub fn now_unix_s() -> i64 {
    now_unix_ms().div_euclid(1_000)
}
