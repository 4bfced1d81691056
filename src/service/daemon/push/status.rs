//! The status of the transfer to the quality system, as shown to people.

use crate::daemon::waiting::TransferBacklog;
use panelprep_base::verdict::Reason;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const ALARM_TEXTS: (&str, &str) =
    ("signed records have not reached the quality system", "the transfer is in progress");

/// The status; all clones share the same one.
#[derive(Debug, Clone, Default)]
pub struct PushStatus(Arc<Mutex<TransferBacklog>>);

impl PushStatus {
    pub(super) fn lock_waiting(&self) -> MutexGuard<'_, TransferBacklog> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the problem for the alarms between cycles: a record that has waited longer than `behind_min`.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let late = self.lock_waiting().overdue_text(behind_min, now_unix_ms, ALARM_TEXTS);
        late.into_iter().map(|words| Reason::new("push_behind", words)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_waits_too_long_is_an_alarm_with_its_cause() {
        let status = PushStatus::default();
        status.lock_waiting().record_backlog(2, Some(60_000));
        assert_eq!(status.reasons(60, 60 * 60_000), []);
        let late = |status: &PushStatus| status.reasons(60, 61 * 60_000).pop().map(|reason| reason.message);
        let words =
            "2 signed records have not reached the quality system; the oldest has waited for 60 min (limit 60 min)";
        assert_eq!(late(&status), Some(format!("{words}: the transfer is in progress")));
        assert!(status.lock_waiting().record_problem(Some("no route")));
        assert!(!status.lock_waiting().record_problem(Some("no route")), "told once");
        assert_eq!(late(&status), Some(format!("{words}: no route")));
        status.lock_waiting().record_backlog(0, None);
        assert_eq!(late(&status), None);
    }
}
