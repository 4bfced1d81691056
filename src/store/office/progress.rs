//! The progress of a cell in sending each epoch, and the office's confirmation.
//!
//! The office decides: data that it does not have is sent again, even if the broker once accepted it. So if a broker
//! or a database is restored without its last days, only time is lost. The same is true if this progress is lost:
//! everything is then sent again, and the office recognizes the items by their names.

use super::position::Position;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The progress of sending, stored beside the store.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// The broker's stream that accepted the data: its name and its creation time.
    stream: String,
    /// The last number that the broker accepted, by epoch.
    sent: BTreeMap<String, u64>,
    /// For each epoch, the number up to which the office has all items.
    archived: BTreeMap<String, u64>,
    /// The number of times that sending began again. A broker drops data with a known name, so data that is sent
    /// again needs another name.
    #[serde(default)]
    again: u64,
}

/// The result of a report from the office on what it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportOutcome {
    /// It has at least the data that the cell expects there.
    Known,
    /// The office has fewer items than before: the missing items are sent again.
    HasLess,
    /// The office has more items than the store ever had: the store does not know its own history, or two cells
    /// have the same name.
    HasMore,
}

impl Progress {
    /// Returns the number of an epoch up to which all items are sent.
    pub fn last_sent(&self, epoch: &str) -> u64 {
        self.sent.get(epoch).copied().unwrap_or(0)
    }

    /// Returns the number of an epoch up to which the office has all items.
    pub fn last_archived(&self, epoch: &str) -> u64 {
        self.archived.get(epoch).copied().unwrap_or(0)
    }

    /// Returns how often sending began again.
    pub fn resend_count(&self) -> u64 {
        self.again
    }

    /// Starts sending again. Repeated data then has a new name, so that the broker does not drop it as a duplicate.
    pub fn restart_sending(&mut self) {
        self.again += 1;
    }

    /// Returns how many items the office does not have yet, given the last number of each epoch.
    pub fn missing_count(&self, last: &[Position]) -> u64 {
        last.iter().map(|last| last.number.saturating_sub(self.last_archived(&last.epoch))).sum()
    }

    /// Records which stream the broker has. A different stream contains nothing of what was sent to the previous one.
    pub fn set_stream(&mut self, stream: &str) {
        if self.stream != stream {
            stream.clone_into(&mut self.stream);
            self.sent = self.archived.clone();
        }
    }

    /// Records that the broker accepted everything up to here; an item that was sent again may be older than the last.
    pub fn record_accepted(&mut self, position: &Position) {
        let sent = self.sent.entry(position.epoch.clone()).or_default();
        *sent = position.number.max(*sent);
    }

    /// Processes the office's report, which states the number up to which the office has all items of an epoch; the
    /// last number in the store is `last`.
    pub fn process_archived(&mut self, epoch: &str, archived: u64, last: u64) -> ReportOutcome {
        if archived > last {
            return ReportOutcome::HasMore;
        }
        let before = self.archived.insert(epoch.to_owned(), archived).unwrap_or(0);
        if archived < before {
            self.sent.insert(epoch.to_owned(), archived);
            self.restart_sending();
            return ReportOutcome::HasLess;
        }
        let sent = self.sent.entry(epoch.to_owned()).or_default();
        *sent = archived.max(*sent);
        ReportOutcome::Known
    }
}
