//! Low-priority threads for the web and plant interfaces: they do not delay the loop or the connection to the robot. If
//! a library panics on data from a network, the thread restarts and the cell continues.

use panelprep_base::supervision;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use tokio::time::{sleep, timeout};

/// Delay before the thread restarts after a panic.
const RESTART_DELAY: Duration = Duration::from_secs(1);
/// Polling interval.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum delay before a retry. The delay is one second after the first failure, then two, four, and so on.
const MAX_RETRY_DELAY: Duration = Duration::from_secs(60);
/// Maximum time for which the program's shutdown waits for blocking work.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);

/// Nice value that is added to the background threads, which lowers their priority.
const NICE: i32 = 5;

/// Gives the calling thread a lower priority than the loop and the connection to the robot.
pub(super) fn lower_priority() {
    #[expect(
        clippy::let_underscore_must_use,
        reason = "the priority of a background thread could not be lowered; the scheduler still gives the loop its \
                  processor time"
    )]
    let _ = rustix::process::setpriority_process(None, NICE);
}

/// The settings of a thread with its own runtime.
pub(super) struct Plan {
    /// The thread's name.
    pub name: &'static str,
    /// The name of the thread's task, for the log.
    pub task: &'static str,
    /// Number of threads for blocking work, such as access to the disk and the look-up of host names.
    pub blocking_threads: usize,
    /// Stack size for deeply nested calls, bytes; `None` for the default size of the system.
    pub stack_bytes: Option<usize>,
}

/// A running background thread. Dropping this value ends the thread and waits for its end.
#[derive(Debug)]
pub(super) struct Background {
    end_sender: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    /// Starts the thread. It runs until `begin` returns, which happens when the thread is requested to end. A panic in
    /// the thread does not stop the cell: `begin` is called again.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn start(
        Plan { name, task: what, blocking_threads: blocking, stack_bytes }: Plan,
        begin: impl AsyncFn(&mut oneshot::Receiver<()>) + Send + 'static,
    ) -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_all().max_blocking_threads(blocking).build()?;
        let (end, ended) = oneshot::channel();
        let work = move || {
            run_until_end(&runtime, what, ended, begin);
            // The shutdown does not wait for a pending look-up of a host name.
            runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
        };
        let builder = thread::Builder::new().name(name.to_owned());
        let builder = match stack_bytes {
            Some(bytes) => builder.stack_size(bytes),
            None => builder,
        };
        Ok(Background { end_sender: Some(end), thread: Some(builder.spawn(work)?) })
    }

    /// Starts a thread that works in rounds. It can be ended between any two steps of a round.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn spawn_rounds<W: Rounds>(plan: Plan, begin: impl Fn() -> W + Send + 'static) -> io::Result<Self> {
        let what = plan.task;
        Background::start(plan, async move |ended| {
            tokio::select! {
                () = run_rounds(begin(), what) => {}
                _ = ended => {}
            }
        })
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        drop(self.end_sender.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn run_until_end(
    runtime: &Runtime,
    what: &str,
    mut ended: oneshot::Receiver<()>,
    begin: impl AsyncFn(&mut oneshot::Receiver<()>),
) {
    supervision::exempt_thread();
    lower_priority();
    while catch_unwind(AssertUnwindSafe(|| runtime.block_on(begin(&mut ended)))).is_err() {
        tracing::warn!("{what} failed (see the log lines above) and starts again");
        if runtime.block_on(async { timeout(RESTART_DELAY, &mut ended).await }).is_ok() {
            return;
        }
    }
}

/// Work that is done in rounds, together with a server that may be unavailable.
pub(super) trait Rounds {
    /// Performs one round; returns whether more work is already waiting.
    async fn run_round(&mut self) -> Result<bool, String>;

    /// Discards all connections after a failure, so that the next round opens new ones.
    fn forget(&mut self);

    /// Logs the result of a round; returns true if the error changed.
    fn report_result(&self, problem: Option<&str>) -> bool;
}

async fn run_rounds(mut work: impl Rounds, what: &str) {
    let mut pause = POLL_INTERVAL;
    loop {
        match work.run_round().await {
            Ok(is_more) => {
                pause = POLL_INTERVAL;
                work.report_result(None);
                if !is_more {
                    sleep(POLL_INTERVAL).await;
                }
            }
            Err(problem) => {
                if work.report_result(Some(&problem)) {
                    tracing::warn!("{what} does not work: {problem}");
                }
                work.forget();
                sleep(pause).await;
                pause = MAX_RETRY_DELAY.min(pause * 2);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// The work panics twice, continues after its third start, and ends when it is requested to end.
    #[test]
    fn a_thread_restarts_after_a_panic_until_it_is_ended() {
        let (end, ended) = oneshot::channel();
        let runs = std::thread::spawn(move || {
            let (begun, end) = (Cell::new(0), Cell::new(Some(end)));
            let runtime = Builder::new_current_thread().enable_time().build().expect("a runtime");
            run_until_end(&runtime, "a front", ended, async |ended| {
                begun.set(begun.get() + 1);
                assert!(begun.get() > 2, "it fails");
                drop(end.take());
                assert!(ended.await.is_err(), "it is reported by dropping the other side");
            });
            begun.get()
        });
        assert_eq!(runs.join().expect("the panics were caught"), 3);
    }
}
