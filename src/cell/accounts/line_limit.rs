//! Limits the number of audit-trail lines that one source writes: of a flood of requests only a few lines remain, and
//! one line that counts the others.

const MINUTE_MS: u64 = 60_000;

/// Maximum numbers of lines in a minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaxLinesPerMinute {
    /// Maximum number of lines about completed actions.
    pub done: u32,
    /// Maximum number of lines about refused actions.
    pub refused: u32,
}

/// The numbers of lines that were written and not written in this minute. Times are ms of any clock that does not
/// jump.
#[derive(Debug, Clone, Copy)]
pub struct LineLimit {
    limits: MaxLinesPerMinute,
    since_ms: u64,
    done: u32,
    refused: u32,
    left_out: u64,
}

impl LineLimit {
    /// Starts with no line in the minute that begins now.
    pub fn new(most: MaxLinesPerMinute, now_ms: u64) -> Self {
        LineLimit { limits: most, since_ms: now_ms, done: 0, refused: 0, left_out: 0 }
    }

    /// Returns whether this line is written; otherwise it is counted.
    pub fn admit_line(&mut self, is_refused: bool) -> bool {
        let (count, most) =
            if is_refused { (&mut self.refused, self.limits.refused) } else { (&mut self.done, self.limits.done) };
        let is_allowed = *count < most;
        if is_allowed {
            *count += 1;
        } else {
            self.left_out += 1;
        }
        is_allowed
    }

    /// Whether the minute is over.
    pub fn has_minute_elapsed(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.since_ms) >= MINUTE_MS
    }

    /// The number of lines that were left out in this minute.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Returns the time until the minute is over, ms.
    pub fn rest_ms(&self, now_ms: u64) -> u64 {
        MINUTE_MS.saturating_sub(now_ms.saturating_sub(self.since_ms))
    }

    /// Ends the minute if it is over: returns how many of its lines were left out, if any, and begins another minute.
    pub fn end_elapsed_minute(&mut self, now_ms: u64) -> Option<u64> {
        if !self.has_minute_elapsed(now_ms) {
            return None;
        }
        let left_out = self.left_out;
        *self = LineLimit::new(self.limits, now_ms);
        (left_out > 0).then_some(left_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_a_few_lines_and_a_number() {
        let mut limit = LineLimit::new(MaxLinesPerMinute { done: 3, refused: 2 }, 500);
        assert_eq!((0..10).filter(|_| limit.admit_line(true)).count(), 2);
        assert_eq!((0..10).filter(|_| limit.admit_line(false)).count(), 3);
        assert_eq!(limit.end_elapsed_minute(60_499), None);
        assert_eq!(limit.end_elapsed_minute(60_500), Some(15));
        assert!(limit.admit_line(true) && limit.admit_line(false));
        assert_eq!(limit.end_elapsed_minute(120_500), None, "nothing was left out");
    }
}
