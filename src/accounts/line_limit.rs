//! Limits the number of audit-trail lines that one source writes: of a flood of requests only a few lines remain, and
//! one line that counts the others.

const MINUTE_MS: u64 = 60_000;

/// Maximum numbers of lines in a minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MostLines {
    /// Maximum number of lines about completed actions.
    pub done: u32,
    /// Maximum number of lines about refused actions.
    pub refused: u32,
}

/// The numbers of lines that were written and not written in this minute. Times are ms of any clock that does not
/// jump.
#[derive(Debug, Clone, Copy)]
pub struct LineLimit {
    most: MostLines,
    since_ms: u64,
    done: u32,
    refused: u32,
    left_out: u64,
}

impl LineLimit {
    /// Starts with no line in the minute that begins now.
    pub fn new(most: MostLines, now_ms: u64) -> Self {
        LineLimit { most, since_ms: now_ms, done: 0, refused: 0, left_out: 0 }
    }

    /// Returns whether this line is written; otherwise it is counted.
    pub fn allows(&mut self, is_refused: bool) -> bool {
        let (count, most) =
            if is_refused { (&mut self.refused, self.most.refused) } else { (&mut self.done, self.most.done) };
        let is_allowed = *count < most;
        if is_allowed {
            *count += 1;
        } else {
            self.left_out += 1;
        }
        is_allowed
    }

    /// Whether the minute is over.
    pub fn is_over(&self, now_ms: u64) -> bool {
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
    pub fn minute_over(&mut self, now_ms: u64) -> Option<u64> {
        if !self.is_over(now_ms) {
            return None;
        }
        let left_out = self.left_out;
        *self = LineLimit::new(self.most, now_ms);
        (left_out > 0).then_some(left_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_a_few_lines_and_a_number() {
        let mut limit = LineLimit::new(MostLines { done: 3, refused: 2 }, 500);
        assert_eq!((0..10).filter(|_| limit.allows(true)).count(), 2);
        assert_eq!((0..10).filter(|_| limit.allows(false)).count(), 3);
        assert_eq!(limit.minute_over(60_499), None);
        assert_eq!(limit.minute_over(60_500), Some(15));
        assert!(limit.allows(true) && limit.allows(false));
        assert_eq!(limit.minute_over(120_500), None, "nothing was left out");
    }
}
