//! Limits the lines about wrong log-ins, at the cell and at the office: of a flood a few lines remain, and the number of
//! the others when the minute is over, even if no other log-in follows.

use crate::accounts::{LineLimit, MaxLinesPerMinute};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of wrong log-ins per minute that have their own line.
const MAX_LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 20 };

/// The wrong log-ins of this minute.
#[derive(Debug)]
pub(super) struct FailedLogins {
    lines: Mutex<LineLimit>,
    begun: Instant,
    /// Added to the clock by a test.
    #[cfg(test)]
    ahead_ms: std::sync::atomic::AtomicU64,
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

impl Default for FailedLogins {
    fn default() -> Self {
        FailedLogins {
            lines: Mutex::new(LineLimit::new(MAX_LINES, 0)),
            begun: Instant::now(),
            #[cfg(test)]
            ahead_ms: std::sync::atomic::AtomicU64::new(0),
        }
    }
}

impl FailedLogins {
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
        let now_ms = u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        #[cfg(test)]
        let now_ms = now_ms + self.ahead_ms.load(std::sync::atomic::Ordering::Relaxed);
        now_ms
    }

    fn lines(&self) -> MutexGuard<'_, LineLimit> {
        // A poisoned lock is harmless: every change under it is complete.
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets the present minute appear to have begun this long ago.
    #[cfg(test)]
    pub fn begin_minute_ago(&self, ago: Duration) {
        let ago_ms = u64::try_from(ago.as_millis()).unwrap_or(u64::MAX);
        self.ahead_ms.store(ago_ms, std::sync::atomic::Ordering::Relaxed);
    }

    /// Ends the present minute now.
    #[cfg(test)]
    pub fn end_minute(&self) -> Option<u64> {
        self.lines().end_elapsed_minute(u64::MAX)
    }
}

/// Describes the lines that were left out.
pub(super) fn words(left_out: u64) -> String {
    format!("{left_out} more wrong log-ins within a minute have no line of their own")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counted by hand: 20 of 25 log-ins have a line. The 21st, at 300 ms, requests the report at 60,000 ms. No other
    /// one does in this minute.
    #[test]
    fn the_first_line_that_is_left_out_requests_the_report() {
        let failed = FailedLogins::default();
        let counted: Vec<Counted> = (0..25).map(|_| failed.count_at(300)).collect();
        assert!(counted[..20].iter().all(|one| one.is_written && one.report_after.is_none()));
        assert!(counted[20..].iter().all(|one| !one.is_written));
        assert_eq!(counted[20].report_after, Some(Duration::from_millis(59_700)));
        assert!(counted[21..].iter().all(|one| one.report_after.is_none()));
        assert_eq!(failed.end_minute(), Some(5));
        assert_eq!(failed.end_minute(), None, "it is reported once");
    }
}
