//! The common parts of the transfers out of the cell: the backlog of a transfer (the number of waiting items, since
//! when they wait, and why they are not sent), and its progress, which is stored in a file in the folder of the store's
//! database. If this file is lost or damaged, the only consequence is that data are sent again.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::fs::File;
use std::io::Write;
use std::path::Path;

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

/// Returns the content of this file in this folder; the default value if the file is missing or cannot be read.
pub(super) fn read_progress<T: DeserializeOwned + Default>(folder: &Path, name: &str) -> T {
    let bytes = panelprep_base::disk::read(&folder.join(name)).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// Writes the progress to this file, either completely or not at all.
///
/// # Errors
/// If the disk cannot be written; the error contains the name of the file.
pub(super) fn write_progress(folder: &Path, name: &str, progress: &impl Serialize) -> Result<(), String> {
    let (path, part) = (folder.join(name), folder.join(format!("{name}.part")));
    let written = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(&serde_json::to_vec(progress)?)?;
        file.sync_all()?;
        fs::rename(&part, &path)
    };
    written().map_err(|error| format!("{}: {error}", path.display()))
}
