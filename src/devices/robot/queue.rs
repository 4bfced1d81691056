//! The requests to the link's thread, and the queue of reports from this thread to the reader.
//!
//! For a reader that is busy for a long time, the queue keeps only the newest state and the newest progress. The number
//! of other reports grows only with commands and faults, so it is limited.

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
    report_count: u64,
    closed: bool,
    /// The time since which at least one report is waiting; `None` if none is waiting.
    unread_since: Option<Instant>,
}

/// The result of reading the queue if no report is waiting.
#[derive(Debug)]
pub(super) struct NoReport {
    /// Number of reports that were added so far.
    pub report_count: u64,
    /// Whether the queue is closed, so that no more reports will follow.
    pub closed: bool,
}

impl ReportQueue {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // The lock is used even after a panic, because every change of the queue is completed under the lock.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a report. If `replaces` is true, a state or progress report replaces the previous one of the same kind,
    /// unless a report of another kind was added in between.
    pub(super) fn add(&self, report: Report, replaces: bool) {
        let mut inside = self.lock();
        // A newer state or progress report replaces the older one. Every other report is an event that a slow reader
        // must not miss.
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
        inside.report_count += 1;
        drop(inside);
        self.changed.notify_one();
    }

    pub(super) fn pop(&self) -> Result<Report, NoReport> {
        let mut inside = self.lock();
        // The reader was active just now, so the waiting time of the next report starts here.
        inside.unread_since = (inside.waiting.len() > 1).then(Instant::now);
        inside.waiting.pop_front().ok_or(NoReport { report_count: inside.report_count, closed: inside.closed })
    }

    /// Records that the reader was active, because it sent a request: the waiting time of reports starts again.
    pub(super) fn mark_active(&self) {
        let mut inside = self.lock();
        inside.unread_since = inside.unread_since.map(|_| Instant::now());
    }

    /// Returns for how long reports have been waiting.
    pub(super) fn unread_for(&self) -> Duration {
        self.lock().unread_since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    pub(super) fn reported_count(&self) -> u64 {
        self.lock().report_count
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
    /// Queues a path of which only the first points are sent until more are permitted.
    QueuePathWithin(Vec<MoveLin>, u32, Reply<CommandId>),
    Permit(Option<CommandId>, Reply<()>),
    OpenEpoch(Epoch, Reply<Epoch>),
    Abort(Reply<()>),
    /// Aborts the open epoch; there is no reply.
    Stop,
    /// Sets the outputs to a production line; there is no reply.
    Line(u32),
    /// Advances the virtual time, unless a report was added since the queue had this number of reports.
    Grant {
        report_count: u64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_kuka::eki::{CommandId, Epoch};

    /// A reader that does not read during a whole path finds the start of the epoch, its end, and the newest progress
    /// report of each kind.
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
