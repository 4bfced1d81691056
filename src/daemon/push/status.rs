//! The status of the transfer to the quality system, as shown to people.

use crate::daemon::waiting::Waiting;
use crate::verdict::Reason;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const WORDS: (&str, &str) = ("signed records have not reached the quality system", "the transfer is in progress");

/// The status; all clones share the same one.
#[derive(Debug, Clone, Default)]
pub struct PushStatus(Arc<Mutex<Waiting>>);

impl PushStatus {
    pub(super) fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the problem for the alarms between cycles: a record that has waited longer than `behind_min`.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let late = self.waiting().late(behind_min, now_unix_ms, WORDS);
        late.into_iter().map(|words| Reason::new("push_behind", words)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_waits_too_long_is_an_alarm_with_its_cause() {
        let status = PushStatus::default();
        status.waiting().is_behind(2, Some(60_000));
        assert_eq!(status.reasons(60, 60 * 60_000), []);
        let late = |status: &PushStatus| status.reasons(60, 61 * 60_000).pop().map(|reason| reason.message);
        let words =
            "2 signed records have not reached the quality system; the oldest has waited for 60 min (limit 60 min)";
        assert_eq!(late(&status), Some(format!("{words}: the transfer is in progress")));
        assert!(status.waiting().goes(Some("no route")));
        assert!(!status.waiting().goes(Some("no route")), "told once");
        assert_eq!(late(&status), Some(format!("{words}: no route")));
        status.waiting().is_behind(0, None);
        assert_eq!(late(&status), None);
    }
}
