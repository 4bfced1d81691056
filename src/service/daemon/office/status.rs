//! The status of the transfer to the office, as shown to people.

use crate::daemon::waiting::TransferBacklog;
use panelprep_base::verdict::Reason;
use panelprep_store::office::RecipeOffer;
use std::sync::{Arc, Mutex, PoisonError};

const ALARM_TEXTS: (&str, &str) =
    ("records have not reached the office", "the archive does not accept the records");

/// The status; all clones share the same one.
#[derive(Debug, Clone, Default)]
pub struct OfficeStatus(Arc<Mutex<StatusData>>);

#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct StatusData {
    /// The records that the office does not have yet.
    waiting: TransferBacklog,
    /// Epochs for which the office reports a higher record number than the store ever had: epoch, the office's number,
    /// the store's number.
    newer_epochs: Vec<(String, u64, u64)>,
    /// The recipes that the office offers.
    offers: Vec<RecipeOffer>,
}

impl OfficeStatus {
    fn change<T>(&self, change: impl FnOnce(&mut StatusData) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Records the present problem, if any; returns whether it is reported for the first time.
    pub(super) fn record_problem(&self, problem: Option<&str>) -> bool {
        self.change(|stands| stands.waiting.record_problem(problem))
    }

    pub(super) fn record_backlog(&self, behind: u64, waits_since_unix_ms: Option<i64>) {
        self.change(|stands| stands.waiting.record_backlog(behind, waits_since_unix_ms));
    }

    pub(super) fn record_newer_epochs(&self, more: Vec<(String, u64, u64)>) {
        self.change(|stands| stands.newer_epochs = more);
    }

    pub(super) fn record_offers(&self, offers: Vec<RecipeOffer>) {
        self.change(|stands| stands.offers = offers);
    }

    /// Returns the recipe that the office offers for this panel, according to the last answers of the office.
    pub fn recipe_offer(&self, panel: &str) -> Option<RecipeOffer> {
        self.change(|stands| stands.offers.iter().find(|offer| offer.panel == panel).cloned())
    }

    /// Returns the problems for the alarms between cycles: a record that waits longer than `behind_min`, and an
    /// office that has more records than the cell.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let StatusData { waiting, newer_epochs: more, offers: _ } = self.change(|stands| stands.clone());
        let late = waiting.overdue_text(behind_min, now_unix_ms, ALARM_TEXTS);
        let mut reasons: Vec<Reason> = late.into_iter().map(|words| Reason::new("office_behind", words)).collect();
        for (epoch, office, store) in more {
            let words = format!(
                "the office has {office} records of epoch {epoch}, but the store of this cell has {store}: the \
                 store was rolled back, or another cell has the same name"
            );
            reasons.push(Reason::new("office_contradicts", words));
        }
        reasons
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_waits_too_long_is_an_alarm_with_its_cause() {
        let status = OfficeStatus::default();
        let minute = 60_000;
        status.record_backlog(3, Some(10 * minute));
        assert_eq!(status.reasons(60, 69 * minute), []);
        let late = |status: &OfficeStatus| status.reasons(60, 70 * minute);
        assert_eq!(late(&status)[0].code, "office_behind");
        assert!(
            late(&status)[0]
                .message
                .ends_with("has waited for 60 min (limit 60 min): the archive does not accept the records")
        );
        assert!(status.record_problem(Some("no route")) && !status.record_problem(Some("no route")), "told once");
        assert!(late(&status)[0].message.ends_with(": no route"));
        status.record_backlog(0, None);
        assert_eq!(late(&status), []);
        status.record_newer_epochs(vec![("ab".to_owned(), 9, 3)]);
        assert_eq!(late(&status)[0].code, "office_contradicts");
    }
}
