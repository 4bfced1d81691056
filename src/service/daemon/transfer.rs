//! The common parts of the transfers out of the cell: the backlog of a transfer (how much data waits, since when, and
//! why it is not sent), the status of each transfer for people and alarms, and its progress in a file in the folder of
//! the store's database. If this file is lost or damaged, the only consequence is that data are sent again.

use crate::setup::disk;
use panelprep_base::verdict::Reason;
use panelprep_store::office::RecipeOffer;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The data that wait for a transfer.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct TransferBacklog {
    /// The reason why no data can be sent now, if any.
    problem: Option<String>,
    count: u64,
    /// The time since which the oldest item has been waiting, ms since 1970.
    since_unix_ms: Option<i64>,
}

impl TransferBacklog {
    /// Records the present problem, if any; returns whether the problem is new.
    pub fn record_problem(&mut self, problem: Option<&str>) -> bool {
        let is_new = problem.is_some() && self.problem.as_deref() != problem;
        self.problem = problem.map(str::to_owned);
        is_new
    }

    /// Records the number of waiting items, and the time since which the oldest has been waiting.
    pub fn record_backlog(&mut self, count: u64, since_unix_ms: Option<i64>) {
        (self.count, self.since_unix_ms) = (count, since_unix_ms);
    }

    /// Returns the text of the alarm with its cause, if data have waited for `behind_min` minutes or longer: "3 … ; the
    /// oldest has waited for …". `what` names the data and their destination; `usual` is the cause if no problem is
    /// recorded.
    pub fn overdue_text(&self, behind_min: usize, now_unix_ms: i64, (what, usual): (&str, &str)) -> Option<String> {
        let TransferBacklog { problem, count, since_unix_ms } = self;
        let waits_min = since_unix_ms.map_or(0, |since| (now_unix_ms - since).max(0) / 60_000);
        let is_late = *count > 0 && usize::try_from(waits_min).is_ok_and(|min| min >= behind_min);
        let why = problem.as_deref().unwrap_or(usual);
        is_late.then(|| {
            format!("{count} {what}; the oldest has waited for {waits_min} min (limit {behind_min} min): {why}")
        })
    }
}

/// The status of the transfers of records out of the cell.
#[derive(Debug, Clone, Default)]
pub struct RecordTransfers {
    /// The transfer to the office.
    pub office: OfficeStatus,
    /// The transfer to the quality system.
    pub push: PushStatus,
}

const OFFICE_ALARM: (&str, &str) =
    ("records have not reached the office server", "the archive does not accept the records");

/// The status of the transfer to the office; all clones share the same one.
#[derive(Debug, Clone, Default)]
pub struct OfficeStatus(Arc<Mutex<StatusData>>);

#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct StatusData {
    /// The records that the office does not have yet.
    waiting: TransferBacklog,
    /// Epochs of which the office has more records than the store ever had: epoch, the office's last record number, the
    /// store's last record number.
    newer_epochs: Vec<(String, u64, u64)>,
    /// The recipes that the office offers.
    offers: Vec<RecipeOffer>,
}

impl OfficeStatus {
    fn change<T>(&self, change: impl FnOnce(&mut StatusData) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Records the present problem, if any; returns whether it is reported for the first time.
    #[cfg(feature = "plant")]
    pub(super) fn record_problem(&self, problem: Option<&str>) -> bool {
        self.change(|stands| stands.waiting.record_problem(problem))
    }

    #[cfg(feature = "plant")]
    pub(super) fn record_backlog(&self, behind: u64, waits_since_unix_ms: Option<i64>) {
        self.change(|stands| stands.waiting.record_backlog(behind, waits_since_unix_ms));
    }

    #[cfg(feature = "plant")]
    pub(super) fn record_newer_epochs(&self, more: Vec<(String, u64, u64)>) {
        self.change(|stands| stands.newer_epochs = more);
    }

    #[cfg(feature = "plant")]
    pub(super) fn record_offers(&self, offers: Vec<RecipeOffer>) {
        self.change(|stands| stands.offers = offers);
    }

    /// Returns the recipe that the office last offered for this panel.
    pub fn recipe_offer(&self, panel: &str) -> Option<RecipeOffer> {
        self.change(|stands| stands.offers.iter().find(|offer| offer.panel == panel).cloned())
    }

    /// Returns the problems for the alarms between cycles: a record that has waited longer than `behind_min`, and an
    /// office that has more records than the cell.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let StatusData { waiting, newer_epochs: more, offers: _ } = self.change(|stands| stands.clone());
        let late = waiting.overdue_text(behind_min, now_unix_ms, OFFICE_ALARM);
        let mut reasons: Vec<Reason> = late.into_iter().map(|words| Reason::new("office_behind", words)).collect();
        for (epoch, office, store) in more {
            let words = format!(
                "the office server has {office} records of epoch {epoch}, but the store of this cell has {store}: the \
                 store was rolled back, or another cell has the same name"
            );
            reasons.push(Reason::new("office_contradicts", words));
        }
        reasons
    }
}

const PUSH_ALARM: (&str, &str) =
    ("signed records have not reached the quality system", "the transfer is in progress");

/// The status of the transfer to the quality system; all clones share the same one.
#[derive(Debug, Clone, Default)]
pub struct PushStatus(Arc<Mutex<TransferBacklog>>);

impl PushStatus {
    pub(super) fn lock_waiting(&self) -> MutexGuard<'_, TransferBacklog> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the problem for the alarms between cycles: a record that has waited longer than `behind_min`.
    pub fn reasons(&self, behind_min: usize, now_unix_ms: i64) -> Vec<Reason> {
        let late = self.lock_waiting().overdue_text(behind_min, now_unix_ms, PUSH_ALARM);
        late.into_iter().map(|words| Reason::new("push_behind", words)).collect()
    }
}

/// Returns the content of the file with this name in this folder; the default value if the file is missing or cannot be
/// read.
pub(super) fn read_progress<T: DeserializeOwned + Default>(folder: &Path, name: &str) -> T {
    let bytes = panelprep_base::disk::read(&folder.join(name)).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// Writes the progress to this file, either completely or not at all.
///
/// # Errors
/// If the disk cannot be written; the error contains the name of the file.
pub(super) fn write_progress(folder: &Path, name: &str, progress: &impl Serialize) -> Result<(), String> {
    let path = folder.join(name);
    let bytes = serde_json::to_vec(progress).map_err(|error| format!("{}: {error}", path.display()))?;
    disk::write_durable(&path, bytes).map_err(|fault| fault.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "plant")]
    #[test]
    fn a_record_that_the_office_lacks_too_long_is_an_alarm_with_its_cause() {
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
