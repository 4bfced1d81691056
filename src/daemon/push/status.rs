//! What people are told of the way to the quality system.

use crate::verdict::Reason;
use std::sync::{Arc, Mutex, PoisonError};

/// How it stands; clones are the same one.
#[derive(Debug, Clone, Default)]
pub struct PushStatus(Arc<Mutex<Stands>>);

#[derive(Debug, Clone, Default)]
struct Stands {
    /// Why nothing is put now.
    problem: Option<String>,
    /// Signed records that the server does not have.
    behind: u64,
    /// When the oldest of them was signed, ms since 1970.
    waits_since_unix_ms: Option<i64>,
}

impl PushStatus {
    fn change<T>(&self, change: impl FnOnce(&mut Stands) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How it goes; whether a problem is told for the first time.
    pub(super) fn goes(&self, problem: Option<&str>) -> bool {
        self.change(|stands| {
            let is_new = problem.is_some() && stands.problem.as_deref() != problem;
            stands.problem = problem.map(str::to_owned);
            is_new
        })
    }

    pub(super) fn is_behind(&self, behind: u64, waits_since_unix_ms: Option<i64>) {
        self.change(|stands| (stands.behind, stands.waits_since_unix_ms) = (behind, waits_since_unix_ms));
    }

    /// What is wrong, for the alarms between cycles: a record that waits longer than `behind_min`.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let Stands { problem, behind, waits_since_unix_ms } = self.change(|stands| stands.clone());
        let waits_min = waits_since_unix_ms.map_or(0, |since| (now_unix_ms - since).max(0) / 60_000);
        if behind == 0 || usize::try_from(waits_min).is_ok_and(|min| min < behind_min) {
            return vec![];
        }
        let why = problem.unwrap_or_else(|| "they are on their way".to_owned());
        let words = format!(
            "{behind} signed records are not in the quality system; the oldest waits for {waits_min} min, allowed are {behind_min}: {why}"
        );
        vec![Reason::new("push_behind", words)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_waits_too_long_is_an_alarm_with_its_cause() {
        let status = PushStatus::default();
        status.is_behind(2, Some(60_000));
        assert_eq!(status.reasons(60, 60 * 60_000), []);
        let late = |status: &PushStatus| status.reasons(60, 61 * 60_000).pop().map(|reason| reason.message);
        let words = "2 signed records are not in the quality system; the oldest waits for 60 min, allowed are 60";
        assert_eq!(late(&status), Some(format!("{words}: they are on their way")));
        assert!(status.goes(Some("no route")) && !status.goes(Some("no route")), "told once");
        assert_eq!(late(&status), Some(format!("{words}: no route")));
        status.is_behind(0, None);
        assert_eq!(late(&status), None);
    }
}
