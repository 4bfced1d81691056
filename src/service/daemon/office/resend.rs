//! Decides when a record that the office still lacks is sent again, although the broker accepted it.

use std::time::{Duration, Instant};

/// A missing record is first sent again after the alarm's delay divided by this number, then after twice as long each
/// time.
const FIRST_RETRY_DIVISOR: u32 = 6;
/// The longest time between two repetitions.
const MAX_RETRY_INTERVAL: Duration = Duration::from_secs(2 * 3_600);

/// Since when the office has made no progress with an epoch, although it lacks records; `None` if it lacks none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MissingRecords(Option<StalledSince>);

#[derive(Debug, Clone, Copy)]
struct StalledSince {
    archived: u64,
    at: Instant,
    pause: Duration,
}

impl MissingRecords {
    /// Records whether the office lacks records, and up to which number it has all. Returns whether the next record
    /// must be sent again.
    pub fn is_resend_due(&mut self, (lacks, archived): (bool, u64), behind_min: usize) -> bool {
        self.is_resend_due_at((lacks, archived), behind_min, Instant::now())
    }

    fn is_resend_due_at(&mut self, (lacks, archived): (bool, u64), behind_min: usize, now: Instant) -> bool {
        let first = Duration::from_secs(60) * u32::try_from(behind_min).unwrap_or(u32::MAX) / FIRST_RETRY_DIVISOR;
        match &mut self.0 {
            Some(since) if lacks && since.archived == archived => {
                let is_due = now.duration_since(since.at) >= since.pause;
                if is_due {
                    (since.at, since.pause) = (now, MAX_RETRY_INTERVAL.min(since.pause * 2));
                }
                is_due
            }
            since => {
                *since = lacks.then_some(StalledSince { archived, at: now, pause: first.min(MAX_RETRY_INTERVAL) });
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With an alarm after 60 min, a record is sent again after 10 min, 20 min later and 40 min later; the times begin
    /// anew when the office makes progress.
    #[test]
    fn it_is_sent_again_after_longer_and_longer_times() {
        let (mut lacking, begin) = (MissingRecords::default(), Instant::now());
        let mut due =
            |told, minute: u64| lacking.is_resend_due_at(told, 60, begin + Duration::from_secs(60 * minute));
        let found: Vec<u64> = (0..=75).filter(|minute| due((true, 7), *minute)).collect();
        assert_eq!(found, [10, 30, 70]);
        assert!(!due((true, 8), 76) && !due((true, 8), 85) && due((true, 8), 86), "it got on");
        assert!(
            !due((false, 9), 200) && !due((true, 9), 300) && due((true, 9), 310),
            "it lacked nothing meanwhile"
        );
    }
}
