//! The actions that need cameras or computation. Each action is one piece of work, with inputs and a result.
//!
//! A [`WorkInput`] owns copies of the artifacts that it reads or changes. It collects the data for the record instead
//! of recording them. So if the work was abandoned in the meantime, its [`WorkResult`] is dropped as a whole, and no
//! part of it is used or recorded. The pieces of work are done one at a time, in the order in which they were
//! submitted, since all of them share the cameras. The queue is processed on its own thread while the loop continues to
//! answer, or by the loop itself if time stops during the computation.
//!
//! A film is evaluated in steps of one picture, and its state stays here. With the wall clock, each step starts
//! automatically after the one before, at the latest `PICTURE_POLL_INTERVAL` after a step without a new picture,
//! whatever the robot and the loop do. In lock step the loop requests each step, so that virtual time determines which
//! picture is evaluated.

mod worker;

pub use worker::CalibrationCheck;
pub(super) use worker::{PerformWork, WorkInput, WorkOutcome, WorkResult, Worker};

use super::error::DaemonError;
use super::live_view::LiveView;
use super::ports::{CameraPort, PictureStore};
use panelprep_base::supervision::{SupervisedThread, Supervisor, supervise};
use panelprep_cell::cycle::{Action, Answer, Id, Trouble};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

/// Maximum duration of a piece of work; if it takes longer, it hangs. The state table has then stopped waiting for the
/// answer long before, and the robot is at standstill. Work that hangs prevents every later action.
const WORK_TIMEOUT: Duration = Duration::from_secs(180);

/// Nice value of the computing thread: its priority is below that of the loop and the robot's link.
pub(super) const NICE: i32 = 19;

/// Pause after a step of a film in which no new picture was found.
const PICTURE_POLL_INTERVAL: Duration = Duration::from_millis(2);

/// The queue of work, and the executor that processes it.
pub struct Computing<'p> {
    /// Whether time stops during a computation. With the wall clock a film continues automatically.
    lock_step: bool,
    /// The number of the piece of work whose result is still awaited.
    awaited_id: Arc<AtomicU64>,
    executor: Executor<'p>,
}

/// The value of `awaited_id` if no result is awaited; no piece of work has this number.
const NO_RESULT_AWAITED: u64 = u64::MAX;

enum Executor<'p> {
    /// The loop computes the result itself when it accepts it.
    Inline { worker: Box<dyn PerformWork + 'p>, queue: VecDeque<WorkInput> },
    /// A separate thread.
    Thread {
        queue: Sender<WorkInput>,
        /// `None` means that the film was abandoned.
        results: Receiver<Option<Box<WorkResult>>>,
        under_way: VecDeque<Id>,
        result: Option<Box<WorkResult>>,
    },
}

impl<'p> Computing<'p> {
    /// Creates an executor that computes when the loop accepts a result; the loop waits for it.
    pub fn inline(cameras: Box<dyn CameraPort + Send + 'p>, lock_step: bool) -> Self {
        // The calibrations need no check here: the command that runs one cycle has just read them.
        Computing::with_worker(Box::new(Worker::new(cameras, Box::new(Vec::new), None)), lock_step)
    }

    /// Creates an executor whose worker computes when the loop accepts a result.
    pub(super) fn with_worker(worker: Box<dyn PerformWork + 'p>, lock_step: bool) -> Self {
        let due = Arc::new(AtomicU64::new(NO_RESULT_AWAITED));
        Computing { lock_step, awaited_id: due, executor: Executor::Inline { worker, queue: VecDeque::new() } }
    }

    /// Starts a thread that computes; call this from the loop's thread. With the wall clock the thread has a lower
    /// priority than the loop and the robot's link, and the loop computes its own part without other threads. The
    /// thread ends when no more work is submitted. The program does not wait for its end, since a camera may hang. The
    /// pictures that the thread evaluates are shown to viewers on `view`.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn on_thread(
        (cameras, readable, keep): (Box<dyn CameraPort + Send>, CalibrationCheck, PictureStore),
        lock_step: bool,
        supervisor: &Supervisor,
        view: LiveView,
    ) -> Result<Self, DaemonError> {
        // A thread cannot leave its pool, so the pool is never dropped.
        let alone = (!lock_step).then(|| use_thread_pool(1)).flatten();
        Box::leak(Box::new(alone));
        let (queue, taken) = mpsc::channel();
        let (tell, results) = mpsc::channel();
        let (sign, watched) = supervise("computing", WORK_TIMEOUT);
        let due = Arc::new(AtomicU64::new(NO_RESULT_AWAITED));
        let mut computes = Thread {
            worker: Worker::new(cameras, readable, Some(keep)).with_live_view(view),
            lock_step,
            awaited_id: due.clone(),
            tell,
            sign,
        };
        let serve = move || computes.serve(&taken);
        thread::Builder::new().name("computing".to_owned()).spawn(serve).map_err(DaemonError::Thread)?;
        supervisor.add_thread(watched);
        let executor = Executor::Thread { queue, results, under_way: VecDeque::new(), result: None };
        Ok(Computing { lock_step, awaited_id: due, executor })
    }

    /// Starts the computation.
    pub(super) fn submit(&mut self, work: WorkInput) {
        // Set before the work is queued: the thread must find the number of this work when it begins.
        self.awaited_id.store(work.id.0, Ordering::Relaxed);
        match &mut self.executor {
            Executor::Inline { queue, .. } => queue.push_back(work),
            Executor::Thread { queue, under_way, .. } => {
                under_way.push_back(work.id);
                #[expect(
                    clippy::let_underscore_must_use,
                    reason = "refused only if the thread has ended, which `ready` detects"
                )]
                let _ = queue.send(work);
            }
        }
    }

    /// Cancels the submitted work.
    pub(super) fn abandon(&mut self) {
        self.awaited_id.store(NO_RESULT_AWAITED, Ordering::Relaxed);
        if let (Executor::Inline { queue, .. }, false) = (&mut self.executor, self.lock_step) {
            queue.retain(|work| work.action != Action::Film);
        }
    }

    /// Returns the id of the next available result; waits at most `patience` for one.
    pub(super) fn ready(&mut self, patience: Duration) -> Option<Id> {
        match &mut self.executor {
            Executor::Inline { queue, .. } => queue.front().map(|work| work.id),
            Executor::Thread { results, under_way, result, .. } => {
                // Results of an abandoned film do not reach the loop.
                let due = self.awaited_id.load(Ordering::Relaxed);
                let is_left = |worked: &WorkResult| !self.lock_step && worked.is_of_film && worked.id.0 != due;
                result.take_if(|worked| is_left(worked));
                while result.is_none() {
                    let id = *under_way.front()?;
                    *result = match results.recv_timeout(patience) {
                        Ok(worked) => worked,
                        Err(RecvTimeoutError::Timeout) => return None,
                        // The loop receives an answer in this case too: the state table waits for it, and a computation
                        // that died is a fault of this action.
                        Err(RecvTimeoutError::Disconnected) => Some(Box::new(lost_result(id))),
                    };
                    if self.lock_step || result.as_ref().is_none_or(|worked| worked.is_last()) {
                        under_way.pop_front();
                    }
                    result.take_if(|worked| is_left(worked));
                }
                result.as_ref().map(|worked| worked.id)
            }
        }
    }

    /// Takes the result that `ready` has reported.
    pub(super) fn ready_result(&mut self) -> Option<WorkResult> {
        match &mut self.executor {
            Executor::Inline { worker, queue } => {
                let work = queue.pop_front()?;
                let next = WorkInput::next_picture_step(work.id, work.action, work.pass, work.setup.clone());
                let worked = worker.perform(work);
                if !self.lock_step && !worked.is_last() {
                    queue.push_front(next);
                }
                Some(worked)
            }
            Executor::Thread { result, .. } => result.take().map(|worked| *worked),
        }
    }
}

/// Creates a pool of `count` threads for parallel computations of the calling thread, which is one of them; 0 means one
/// thread for each processor. All threads of the pool have the priority of the calling thread. Rayon's global pool
/// inherits the priority of its first caller: a loop that waits for it is late for the robot while other programs use
/// the processors. Returns `None` if the thread already has a pool or the system provides no threads; the global pool
/// then computes.
fn use_thread_pool(count: usize) -> Option<rayon::ThreadPool> {
    let name = |_| "computing".to_owned();
    rayon::ThreadPoolBuilder::new().num_threads(count).use_current_thread().thread_name(name).build().ok()
}

/// The thread that computes.
struct Thread {
    worker: Worker<'static>,
    lock_step: bool,
    awaited_id: Arc<AtomicU64>,
    tell: Sender<Option<Box<WorkResult>>>,
    sign: SupervisedThread,
}

impl Thread {
    fn serve(&mut self, taken: &Receiver<WorkInput>) {
        if !self.lock_step
            && let Err(error) = rustix::process::setpriority_process(None, NICE)
        {
            tracing::warn!("cannot lower the priority of the computing thread: {error}");
        }
        // The threads of the pool have the same lowered priority as this one.
        let _own = (!self.lock_step).then(|| use_thread_pool(0));
        for work in taken {
            if self.perform_work(work).is_err() {
                break;
            }
        }
        self.sign.report_done();
    }

    /// Does one piece of work; with the wall clock, evaluates a film to its end. Returns an error if the results are
    /// not received any more.
    fn perform_work(&mut self, work: WorkInput) -> Result<(), mpsc::SendError<Option<Box<WorkResult>>>> {
        let (id, act, pass, setup) = (work.id, work.action, work.pass, work.setup.clone());
        let mut next = Some(work);
        while let Some(work) = next.take() {
            self.sign.report_working();
            let worked = self.worker.perform(work);
            self.sign.report_resting();
            if !self.lock_step && !worked.is_last() {
                // If a film that is no longer needed continued to its end, it would block the camera for the next
                // action.
                if self.awaited_id.load(Ordering::Relaxed) != id.0 {
                    return self.tell.send(None);
                }
                next = Some(WorkInput::next_picture_step(id, act, pass, setup.clone()));
                if worked.notes.is_empty() {
                    thread::sleep(PICTURE_POLL_INTERVAL);
                    continue;
                }
            }
            self.tell.send(Some(Box::new(worked)))?;
        }
        Ok(())
    }
}

/// Returns the result for work whose thread ended because of a fault, which is already logged.
fn lost_result(id: Id) -> WorkResult {
    let found = Ok(WorkOutcome::Answer(Answer::Failed(Trouble::Computing)));
    WorkResult { id, outcome: found, artifacts: None, notes: vec![], is_of_film: false }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::collections::HashSet;
    use std::thread::ThreadId;

    fn threads() -> HashSet<ThreadId> {
        (0..1_000).into_par_iter().map(|_| thread::current().id()).collect()
    }

    /// Returns the calling thread, which creates a pool with this number of threads, and the threads that compute for
    /// it.
    fn threads_used(count: usize) -> (ThreadId, HashSet<ThreadId>) {
        let asked = move || {
            let own = use_thread_pool(count);
            assert!(own.is_some() && use_thread_pool(count).is_none(), "once for a thread");
            (thread::current().id(), threads())
        };
        thread::spawn(asked).join().expect("it ends")
    }

    #[test]
    fn a_loop_computes_alone_and_others_share_their_threads() {
        let (own, used) = threads_used(1);
        assert_eq!(used, HashSet::from([own]));
        let (own, used) = thread::spawn(|| (thread::current().id(), threads())).join().expect("it ends");
        assert!(!used.contains(&own), "the threads of all");
    }

    #[test]
    fn pool_threads_have_the_priority_of_their_caller() {
        let niceness = || rustix::process::getpriority_process(None).expect("its own");
        let of_all = thread::spawn(move || {
            rustix::process::setpriority_process(None, NICE).expect("anybody may step back");
            let own = use_thread_pool(2).expect("threads");
            let found: Vec<i32> = own.broadcast(|_| niceness());
            found
        });
        assert_eq!(of_all.join().expect("it ends"), [NICE; 2]);
    }
}
