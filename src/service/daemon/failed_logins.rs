//! Limits the lines about wrong log-ins, at the cell and at the office: of a flood a few lines remain, and the number of
//! the others when the minute is over, even if no other log-in follows.

use panelprep_cell::accounts::{LineLimit, MaxLinesPerMinute};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of wrong log-ins per minute that have their own line.
const MAX_LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 20 };

/// The wrong log-ins of this minute.
#[derive(Debug)]
pub(super) struct FailedLogins {
    lines: Mutex<LineLimit>,
    begun: Instant,
}

/// Consequences of a failed log-in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counted {
    /// Number of lines that were left out in the minute before, to be written first.
    pub left_out: Option<u64>,
    /// Whether this log-in has its own line.
    pub is_written: bool,
    /// Time after which [`FailedLogins::over`] must be called; `None` if a call is already due or not needed.
    pub report_after: Option<Duration>,
}

impl FailedLogins {
    /// Starts without a wrong log-in; the first minute began at this time.
    pub fn new(begun: Instant) -> Self {
        FailedLogins { lines: Mutex::new(LineLimit::new(MAX_LINES, 0)), begun }
    }

    /// Counts a wrong log-in.
    pub fn count(&self) -> Counted {
        self.count_at(self.now_ms())
    }

    /// Returns the number of lines that were left out in a minute that is over, if it was not yet returned.
    pub fn over(&self) -> Option<u64> {
        self.lines().end_elapsed_minute(self.now_ms())
    }

    fn count_at(&self, now_ms: u64) -> Counted {
        let mut lines = self.lines();
        let left_out = lines.end_elapsed_minute(now_ms);
        let is_written = lines.admit_line(true);
        // The first line that is left out requests the report for all that follow in this minute.
        let is_first = !is_written && lines.left_out() == 1;
        let report_after = is_first.then(|| Duration::from_millis(lines.rest_ms(now_ms)));
        Counted { left_out, is_written, report_after }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn lines(&self) -> MutexGuard<'_, LineLimit> {
        // A poisoned lock is harmless: every change under it is complete.
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Describes the lines that were left out.
pub(super) fn words(left_out: u64) -> String {
    format!("further wrong log-ins within a minute, without a line of their own: {left_out}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counted by hand: 20 of 25 log-ins have a line. The 21st, at 300 ms, requests the report at 60,000 ms. No other
    /// one does in this minute.
    #[test]
    fn the_first_line_that_is_left_out_requests_the_report() {
        let failed = FailedLogins::new(Instant::now());
        let counted: Vec<Counted> = (0..25).map(|_| failed.count_at(300)).collect();
        assert!(counted[..20].iter().all(|one| one.is_written && one.report_after.is_none()));
        assert!(counted[20..].iter().all(|one| !one.is_written));
        assert_eq!(counted[20].report_after, Some(Duration::from_millis(59_700)));
        assert!(counted[21..].iter().all(|one| one.report_after.is_none()));
        assert_eq!(failed.lines().end_elapsed_minute(59_999), None, "the minute is not over");
        assert_eq!(failed.lines().end_elapsed_minute(60_000), Some(5));
        assert_eq!(failed.lines().end_elapsed_minute(120_000), None, "it is reported once");
    }
}
