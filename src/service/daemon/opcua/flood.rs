//! Limits how often each caller may call methods. Stop and abort are not counted: several in a row are answered
//! together.

use std::collections::BTreeMap;

/// Number of calls that are permitted at once; `CALLS_PER_SECOND` applies after that.
const BURST_CALLS: f64 = 20.0;
const CALLS_PER_SECOND: f64 = 5.0;
/// Largest number of remembered callers; those without a call for the longest time are removed first.
const MAX_CALLERS: usize = 256;
/// Time after which a flood is reported again.
const REPORT_INTERVAL_S: f64 = 60.0;

/// The call budget of each caller. Times are seconds of any clock that does not jump.
#[derive(Debug, Default)]
pub(super) struct CallLimiter(BTreeMap<String, Bucket>);

#[derive(Debug, Clone, Copy)]
struct Bucket {
    remaining: f64,
    at_s: f64,
    reported_s: Option<f64>,
}

/// Decision about a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CallDecision {
    /// The call is accepted.
    Accepted,
    /// The call exceeds the limit; states whether this is to be reported.
    TooMany {
        /// False if it was reported lately.
        is_recently_reported: bool,
    },
}

impl CallLimiter {
    /// Counts a call by this caller and returns what happens to it.
    pub fn call(&mut self, caller: &str, now_s: f64) -> CallDecision {
        if self.0.len() >= MAX_CALLERS && !self.0.contains_key(caller) {
            let oldest = self.0.iter().min_by(|a, b| a.1.at_s.total_cmp(&b.1.at_s)).map(|(name, _)| name.clone());
            oldest.and_then(|name| self.0.remove(&name));
        }
        let bucket = self.0.entry(caller.to_owned()).or_insert(Bucket {
            remaining: BURST_CALLS,
            at_s: now_s,
            reported_s: None,
        });
        bucket.remaining = (bucket.remaining + (now_s - bucket.at_s) * CALLS_PER_SECOND).min(BURST_CALLS);
        bucket.at_s = now_s;
        if bucket.remaining >= 1.0 {
            bucket.remaining -= 1.0;
            return CallDecision::Accepted;
        }
        let is_told = bucket.reported_s.is_none_or(|told_s| now_s - told_s >= REPORT_INTERVAL_S);
        if is_told {
            bucket.reported_s = Some(now_s);
        }
        CallDecision::TooMany { is_recently_reported: is_told }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: 20 calls at once; after 2 s, 10 more; another caller is not affected; the excess is
    /// reported once in a minute.
    #[test]
    fn calls_beyond_the_measure_are_too_many_and_reported_once() {
        let mut flood = CallLimiter::default();
        let mut taken =
            |caller: &str, now_s| (0..100).filter(|_| flood.call(caller, now_s) == CallDecision::Accepted).count();
        assert_eq!(taken("anna", 0.0), 20);
        assert_eq!(taken("anna", 2.0), 10);
        assert_eq!(taken("ben", 2.0), 20);
        let mut flood = CallLimiter::default();
        let told: Vec<usize> = (0..12_000)
            .filter(|n| {
                flood.call("anna", *n as f64 / 100.0) == CallDecision::TooMany { is_recently_reported: true }
            })
            .collect();
        assert_eq!(told.len(), 2, "{told:?}: twelve thousand calls in two minutes");
    }

    #[test]
    fn the_number_of_remembered_callers_is_limited() {
        let mut flood = CallLimiter::default();
        for n in 0..2_000 {
            flood.call(&format!("n{n}"), f64::from(n));
        }
        assert_eq!(flood.0.len(), MAX_CALLERS);
    }
}
