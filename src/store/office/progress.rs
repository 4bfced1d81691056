//! The progress of sending in each epoch, the confirmation by the office server, and the comparison between the data of
//! the cell and of the office server.
//!
//! The office server's report decides: items that it does not have are sent again, even if the broker has accepted them
//! before. If a broker or a database is restored without its last days, the items are therefore only delayed. If this
//! progress file is lost, all items are sent again, and the office server recognises them by their positions.

use super::message::{ListEntry, Position};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The progress of sending, stored in a file beside the store.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// The stream of the broker that accepted the items: its name and its creation time.
    stream: String,
    /// The last number that the broker accepted, for each epoch.
    sent: BTreeMap<String, u64>,
    /// The number up to which the office server has all items, for each epoch.
    archived: BTreeMap<String, u64>,
    /// The number of times that sending was restarted. A broker drops data with a known name, so data that is sent
    /// again needs another name.
    again: u64,
}

/// What the office server's report about its items shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportOutcome {
    /// The office server has at least as many items as in its last report.
    Known,
    /// The office server has fewer items than in its last report; the missing items are sent again.
    HasLess,
    /// The office server has more items than the store: rows of the store are missing, or two cells use the same name.
    HasMore,
}

impl Progress {
    /// Returns the number up to which all items of an epoch were sent.
    pub fn last_sent(&self, epoch: &str) -> u64 {
        self.sent.get(epoch).copied().unwrap_or(0)
    }

    /// Returns the number up to which the office server has all items of an epoch.
    pub fn last_archived(&self, epoch: &str) -> u64 {
        self.archived.get(epoch).copied().unwrap_or(0)
    }

    /// Returns how many times sending was restarted.
    pub fn resend_count(&self) -> u64 {
        self.again
    }

    /// Restarts sending. The items then get new message ids, so that the broker does not drop them as duplicates.
    pub fn restart_sending(&mut self) {
        self.again += 1;
    }

    /// Returns the number of items that the office server does not have yet. `last` is the last position in each epoch.
    pub fn missing_count(&self, last: &[Position]) -> u64 {
        last.iter().map(|last| last.number.saturating_sub(self.last_archived(&last.epoch))).sum()
    }

    /// Records the stream of the broker. A new stream contains no earlier items, so that all items that the office
    /// server does not have are sent again.
    pub fn set_stream(&mut self, stream: &str) {
        if self.stream != stream {
            stream.clone_into(&mut self.stream);
            self.sent = self.archived.clone();
        }
    }

    /// Records that the broker has accepted all items up to this position. The position of a repeated item does not
    /// decrease the number.
    pub fn record_accepted(&mut self, position: &Position) {
        let sent = self.sent.entry(position.epoch.clone()).or_default();
        *sent = position.number.max(*sent);
    }

    /// Processes a report of the office server: `archived` is the number up to which it has all items of an epoch,
    /// `last` is the last number in the store.
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

/// Maximum number of differences of the same kind that are listed; further ones are only counted.
const MAX_LISTED_DIFFERENCES: usize = 50;

/// The result of comparing two lists of items.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Comparison {
    /// Number of items that have the same hash in both lists.
    pub equal_items: u64,
    /// The differences, as texts.
    pub differences: Vec<String>,
}

/// Compares the cell's list of items with the office server's list.
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
                "{} differs: the cell has a {} with the SHA-256 {}, the office server has a {} with {}",
                name_position(&position),
                line.kind.keyword(),
                line.hash,
                found.kind.keyword(),
                found.hash
            )),
            None => missing.push(format!(
                "{} has not been received by the office server yet and is sent again automatically: {}",
                name_position(&position),
                line.kind.keyword()
            )),
        }
    }
    let more = office.keys().map(|position| {
        format!(
            "{} is on the office server, but not in the cell; run panelprep store verify on the cell",
            name_position(position)
        )
    });
    let more: Vec<String> = more.collect();
    for (mut words, of_all) in
        [(other, "differ"), (missing, "are not on the office server"), (more, "are not in the cell")]
    {
        let rest = words.len().saturating_sub(MAX_LISTED_DIFFERENCES);
        words.truncate(MAX_LISTED_DIFFERENCES);
        compared.differences.append(&mut words);
        compared.differences.extend((rest > 0).then(|| format!("{rest} more {of_all}")));
    }
    compared
}

fn name_position(position: &Position) -> String {
    format!("number {} of epoch {}", position.number, position.epoch)
}
