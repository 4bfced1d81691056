//! The time of the session's clock.

use std::time::Duration;

/// A moment, counted from any fixed start: that of the link on a real robot, that of the controller in lock step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Time(Duration);

impl Time {
    /// Returns the moment at this time after the start.
    pub fn from_start(since: Duration) -> Self {
        Time(since)
    }

    /// Returns the moment at this count of milliseconds.
    pub fn from_ms(ms: u64) -> Self {
        Time(Duration::from_millis(ms))
    }

    /// Returns the time since the start.
    pub fn since_start(self) -> Duration {
        self.0
    }

    /// Returns the time since `earlier`; zero if `earlier` is not in the past.
    pub fn since(self, earlier: Time) -> Duration {
        self.0.saturating_sub(earlier.0)
    }
}

impl std::ops::Add<Duration> for Time {
    type Output = Time;
    fn add(self, span: Duration) -> Time {
        Time(self.0.saturating_add(span))
    }
}
