//! The progress of a cell in sending each epoch, the office's confirmation, and the comparison of the cell's data with
//! the office's data.
//!
//! The office decides: data that it does not have is sent again, even if the broker once accepted it. If a broker or a
//! database is restored without its last days, the data is therefore only delayed. If this progress file is lost, all
//! data is sent again, and the office recognizes the items by their names.

use super::message::{ListEntry, Position};
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
    /// The number of times that sending was restarted. A broker drops data with a known name, so data that is sent
    /// again needs another name.
    #[serde(default)]
    again: u64,
}

/// The result of the office's report of the items that it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportOutcome {
    /// The office has at least the items that it reported before.
    Known,
    /// The office has fewer items than before: the missing items are sent again.
    HasLess,
    /// The office has more items than the store ever had: rows of the store are missing, or two cells have the same
    /// name.
    HasMore,
}

impl Progress {
    /// Returns the number up to which all items of an epoch are sent.
    pub fn last_sent(&self, epoch: &str) -> u64 {
        self.sent.get(epoch).copied().unwrap_or(0)
    }

    /// Returns the number up to which the office has all items of an epoch.
    pub fn last_archived(&self, epoch: &str) -> u64 {
        self.archived.get(epoch).copied().unwrap_or(0)
    }

    /// Returns how often sending was restarted.
    pub fn resend_count(&self) -> u64 {
        self.again
    }

    /// Restarts sending. Repeated data then has a new name, so that the broker does not drop it as a duplicate.
    pub fn restart_sending(&mut self) {
        self.again += 1;
    }

    /// Returns how many items the office does not have yet, given the last number of each epoch.
    pub fn missing_count(&self, last: &[Position]) -> u64 {
        last.iter().map(|last| last.number.saturating_sub(self.last_archived(&last.epoch))).sum()
    }

    /// Records the broker's stream. If it is another stream than before, all items that the office does not have are
    /// sent again, because the new stream does not contain them.
    pub fn set_stream(&mut self, stream: &str) {
        if self.stream != stream {
            stream.clone_into(&mut self.stream);
            self.sent = self.archived.clone();
        }
    }

    /// Records that the broker accepted all items up to this position; an item that was sent again may be older than
    /// the last.
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

/// Maximum number of listed messages of one kind; further messages are only counted.
const MAX_MESSAGES: usize = 50;

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Comparison {
    /// Number of items with the same hash in the cell and in the office.
    pub equal_items: u64,
    /// The differences, as text.
    pub differences: Vec<String>,
}

/// Compares the office's list of a cell with the cell's own list.
pub fn compare(cell: &[ListEntry], office: &[ListEntry]) -> Comparison {
    let by_position = |list: &[ListEntry]| -> BTreeMap<Position, ListEntry> {
        list.iter().map(|line| (line.position.clone(), line.clone())).collect()
    };
    let (cell, mut office) = (by_position(cell), by_position(office));
    let mut compared = Comparison::default();
    let (mut missing, mut other) = (Vec::new(), Vec::new());
    for (position, line) in cell {
        match office.remove(&position) {
            Some(found) if found == line => compared.equal_items += 1,
            Some(found) => other.push(format!(
                "{} differs: the cell has a {} with the SHA-256 {}, the office has a {} with {}",
                name_position(&position),
                line.kind.keyword(),
                line.hash,
                found.kind.keyword(),
                found.hash
            )),
            None => missing.push(format!(
                "{} is not in the office yet: {}",
                name_position(&position),
                line.kind.keyword()
            )),
        }
    }
    let more =
        office.keys().map(|position| format!("{} is in the office, but not in the cell", name_position(position)));
    let more: Vec<String> = more.collect();
    for (mut words, of_all) in
        [(other, "differ"), (missing, "are not in the office"), (more, "are not in the cell")]
    {
        let rest = words.len().saturating_sub(MAX_MESSAGES);
        words.truncate(MAX_MESSAGES);
        compared.differences.append(&mut words);
        compared.differences.extend((rest > 0).then(|| format!("{rest} more {of_all}")));
    }
    compared
}

fn name_position(position: &Position) -> String {
    format!("number {} of epoch {}", position.number, position.epoch)
}
