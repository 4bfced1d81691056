//! The requests to the link's thread, and the queue of reports from this thread to their reader.
//!
//! A reader that is busy for a long time finds only the newest state and the newest progress. The number of other
//! reports grows only with commands and faults, which the reader itself has requested.

use panelprep_kuka::eki::{Command, CommandId, Epoch, MoveLin, QueueError, Report};
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot};

#[derive(Debug, Default)]
pub(super) struct ReportQueue {
    inside: Mutex<Inside>,
    changed: Notify,
}

#[derive(Debug, Default)]
struct Inside {
    waiting: VecDeque<Report>,
    told: u64,
    closed: bool,
    /// Since when a report waits that has not been fetched.
    unread_since: Option<Instant>,
}

/// The result if no report is waiting.
#[derive(Debug)]
pub(super) struct NoReport {
    /// Number of reports so far.
    pub told: u64,
    /// No more reports will come.
    pub closed: bool,
}

impl ReportQueue {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // Every change is completed under the lock.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a report. If `replaces` is set, a state or progress replaces an older report of the same kind, provided
    /// that only states and progress were added after the older one.
    pub(super) fn add(&self, report: Report, replaces: bool) {
        let mut inside = self.lock();
        // States and progress supersede each other; every other report is an event that a slow reader must not miss.
        let passing = |report: &Report| matches!(report, Report::State(_) | Report::Progress { .. });
        let kind = std::mem::discriminant(&report);
        let run = inside.waiting.iter().rev().take_while(|old| passing(old));
        let old = run.enumerate().find(|(_, old)| std::mem::discriminant(*old) == kind).map(|(back, _)| back);
        if let Some(back) = old.filter(|_| replaces && passing(&report)) {
            let at = inside.waiting.len() - 1 - back;
            inside.waiting.remove(at);
        }
        inside.waiting.push_back(report);
        inside.unread_since.get_or_insert_with(Instant::now);
        inside.told += 1;
        drop(inside);
        self.changed.notify_one();
    }

    pub(super) fn pop(&self) -> Result<Report, NoReport> {
        let mut inside = self.lock();
        // The reader is alive at this moment, so that the time of the next report counts from here.
        inside.unread_since = (inside.waiting.len() > 1).then(Instant::now);
        inside.waiting.pop_front().ok_or(NoReport { told: inside.told, closed: inside.closed })
    }

    /// Records that the program was active by sending a request: reports then count as unread from now on only.
    pub(super) fn mark_active(&self) {
        let mut inside = self.lock();
        inside.unread_since = inside.unread_since.map(|_| Instant::now());
    }

    /// Returns how long the waiting reports have not been fetched.
    pub(super) fn unread_for(&self) -> Duration {
        self.lock().unread_since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    pub(super) fn reported_count(&self) -> u64 {
        self.lock().told
    }

    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_one();
    }

    /// Waits until the queue may have changed.
    pub(super) async fn changed(&self) {
        self.changed.notified().await;
    }
}

type Reply<T> = oneshot::Sender<Result<T, QueueError>>;

#[derive(Debug)]
pub(super) enum LinkRequest {
    Queue(Command, Reply<CommandId>),
    QueuePath(Vec<MoveLin>, Reply<CommandId>),
    /// A path of which only the first points are sent before more are permitted.
    QueuePathWithin(Vec<MoveLin>, u32, Reply<CommandId>),
    Permit(Option<CommandId>, Reply<()>),
    OpenEpoch(Epoch, Reply<Epoch>),
    Abort(Reply<()>),
    /// Aborts the open epoch; there is no answer.
    Stop,
    /// The outputs to a line; no caller waits for them.
    Line(u32),
    /// Lets virtual time pass, if no report was added since this count of reports.
    Grant {
        told: u64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_kuka::eki::{CommandId, Epoch};

    /// A reader that does not read during a whole path finds the start of the epoch, its end, and the newest report of
    /// each kind of progress.
    #[test]
    fn only_the_newest_progress_waits_and_nothing_else_is_lost() {
        let queue = ReportQueue::default();
        let progress = |done| Report::Progress { done: CommandId(done) };
        let opened = Report::EpochOpened { epoch: Epoch(2) };
        for report in [progress(1), progress(2), opened.clone(), progress(1), progress(5), progress(9)] {
            queue.add(report, true);
        }
        let taken: Vec<Report> = std::iter::from_fn(|| queue.pop().ok()).collect();
        assert_eq!(taken, [progress(2), opened, progress(9)]);
        assert_eq!(queue.reported_count(), 6);
    }
}
