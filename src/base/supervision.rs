//! Supervises the program's threads. Each thread that the cell depends on reports regularly that it works, and a
//! [`Supervisor`] checks all reports.
//!
//! A report from one thread proves nothing about the others. Therefore systemd's watchdog is triggered, and the cycle
//! continues, only while every thread reports. A thread that panics, ends unexpectedly or is silent for too long is a
//! [`ThreadFault`]; the program then stops the robot and ends.

use std::cell::Cell;
use std::fmt;
use std::panic;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A fault of a thread: its name and its failure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThreadFault {
    /// The thread's name.
    pub thread: String,
    /// The way in which the thread failed.
    pub failure: ThreadFailure,
}

/// The ways in which a thread fails.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ThreadFailure {
    /// The thread panicked; the panic hook has already logged the panic.
    Panicked,
    /// The thread ended without a request to end.
    Ended,
    /// The thread has not reported for this time.
    Silent(Duration),
}

impl fmt::Display for ThreadFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ThreadFault { thread, failure: what } = self;
        match what {
            ThreadFailure::Panicked => write!(f, "the thread \"{thread}\" panicked")?,
            ThreadFailure::Ended => write!(f, "the thread \"{thread}\" ended unexpectedly")?,
            ThreadFailure::Silent(since) => {
                write!(f, "the thread \"{thread}\" has not responded for {:.1} s", since.as_secs_f64())?;
            }
        }
        f.write_str("; this is a fault of the program: the robot is stopped and the program ends")
    }
}

impl std::error::Error for ThreadFault {}

/// The last report of a thread about its state.
#[derive(Debug, Clone, Copy)]
enum ThreadReport {
    /// The thread worked at this time, and must report again.
    Works(Instant),
    /// The thread waits for work and need not report.
    Rests,
    /// The thread ended on request.
    Done,
    /// The thread ended without a request, for example by a panic.
    Lost,
}

#[derive(Debug)]
struct Thread {
    name: &'static str,
    longest_silence: Duration,
    sign: Mutex<ThreadReport>,
}

impl Thread {
    fn sign(&self) -> MutexGuard<'_, ThreadReport> {
        self.sign.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn current_failure(&self) -> Option<ThreadFailure> {
        match *self.sign() {
            ThreadReport::Works(at) => {
                Some(at.elapsed()).filter(|since| *since > self.longest_silence).map(ThreadFailure::Silent)
            }
            ThreadReport::Rests | ThreadReport::Done => None,
            ThreadReport::Lost => Some(ThreadFailure::Ended),
        }
    }
}

/// The handle with which a supervised thread reports; it moves into the thread. If it is dropped without
/// [`SupervisedThread::report_done`], the thread has failed.
#[derive(Debug)]
pub struct SupervisedThread(Arc<Thread>);

/// The handle with which the [`Supervisor`] checks a thread.
#[derive(Debug, Clone)]
pub struct WatchedThread(Arc<Thread>);

/// Creates both handles for a thread of this name. The thread must report at least once in `longest_silence` that it
/// works, or report that it rests.
pub fn supervise(name: &'static str, longest_silence: Duration) -> (SupervisedThread, WatchedThread) {
    #[cfg(debug_assertions)]
    let longest_silence = injected::limit_silence(longest_silence);
    let thread = Arc::new(Thread { name, longest_silence, sign: Mutex::new(ThreadReport::Rests) });
    (SupervisedThread(thread.clone()), WatchedThread(thread))
}

impl SupervisedThread {
    /// Reports that the thread works. The thread calls this in each iteration of its loop.
    pub fn report_working(&self) {
        *self.0.sign() = ThreadReport::Works(Instant::now());
        #[cfg(debug_assertions)]
        injected::inject_fault(self.0.name);
    }

    /// Reports that the thread waits for work.
    pub fn report_resting(&self) {
        *self.0.sign() = ThreadReport::Rests;
    }

    /// Reports that the thread ends on request.
    pub fn report_done(&self) {
        *self.0.sign() = ThreadReport::Done;
    }
}

impl Drop for SupervisedThread {
    fn drop(&mut self) {
        let mut sign = self.0.sign();
        if !matches!(*sign, ThreadReport::Done) {
            *sign = ThreadReport::Lost;
        }
    }
}

impl WatchedThread {
    /// Checks whether the thread has failed.
    ///
    /// # Errors
    /// If the thread panicked, ended without a request, or is silent for too long.
    pub fn check_thread(&self) -> Result<(), ThreadFault> {
        self.0
            .current_failure()
            .map_or(Ok(()), |what| Err(ThreadFault { thread: self.0.name.to_owned(), failure: what }))
    }
}

thread_local! {
    /// Whether panics of this thread are not faults of the cell.
    static IS_EXEMPT: Cell<bool> = const { Cell::new(false) };
}

/// Exempts the calling thread: from now on its panics are not faults of the cell. This is for a thread that runs
/// foreign code on input from the network and catches its panics: such input must not stop the robot.
pub fn exempt_thread() {
    IS_EXEMPT.set(true);
}

/// The list of all supervised threads. Clones share the same list.
#[derive(Debug, Clone, Default)]
pub struct Supervisor(Arc<Mutex<SupervisorState>>);

#[derive(Debug, Default)]
struct SupervisorState {
    threads: Vec<WatchedThread>,
    panicked: Option<String>,
}

impl Supervisor {
    /// Adds a thread to the list. The thread is removed when it has ended on request.
    pub fn add_thread(&self, thread: WatchedThread) {
        let mut inside = self.lock();
        inside.threads.retain(|watched| !matches!(*watched.0.sign(), ThreadReport::Done));
        inside.threads.push(thread);
    }

    /// Installs a panic hook: from now on a panic of any thread of this process, with or without a name, is a fault
    /// that [`Supervisor::check_threads`] reports.
    pub fn record_all_panics(&self) {
        let (supervisor, report) = (self.clone(), panic::take_hook());
        panic::set_hook(Box::new(move |panicked| {
            report(panicked);
            if IS_EXEMPT.get() {
                return;
            }
            supervisor.record_panic(std::thread::current().name().unwrap_or("without a name"));
        }));
    }

    /// Records that a thread of this name panicked.
    fn record_panic(&self, thread: &str) {
        self.lock().panicked.get_or_insert_with(|| thread.to_owned());
    }

    /// Checks that no thread has failed.
    ///
    /// # Errors
    /// The first fault that is found.
    pub fn check_threads(&self) -> Result<(), ThreadFault> {
        let inside = self.lock();
        if let Some(thread) = &inside.panicked {
            return Err(ThreadFault { thread: thread.clone(), failure: ThreadFailure::Panicked });
        }
        inside.threads.iter().try_for_each(WatchedThread::check_thread)
    }

    fn lock(&self) -> MutexGuard<'_, SupervisorState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Injects faults for tests of the whole program; a release build does not contain this. `PANELPREP_INJECT` names a
/// file. If the file contains `panic NAME` or `hang NAME`, the supervised thread of that name panics or hangs at its
/// next report. The limit of every thread's silence is then at most three seconds, to keep the test short.
#[cfg(debug_assertions)]
mod injected {
    use std::sync::LazyLock;
    use std::time::Duration;

    static FILE: LazyLock<Option<String>> = LazyLock::new(|| std::env::var("PANELPREP_INJECT").ok());

    pub(super) fn limit_silence(silence: Duration) -> Duration {
        if FILE.is_some() { silence.min(Duration::from_secs(3)) } else { silence }
    }

    #[expect(clippy::panic, reason = "a test fault that PANELPREP_INJECT requested")]
    pub(super) fn inject_fault(thread: &str) {
        // A second panic during unwinding would abort the process before it could report the first one.
        if std::thread::panicking() {
            return;
        }
        let asked = FILE.as_ref().and_then(|file| std::fs::read_to_string(file).ok()).unwrap_or_default();
        match asked.trim().split_once(' ') {
            Some(("panic", name)) if name == thread => panic!("injected"),
            Some(("hang", name)) if name == thread => loop {
                std::thread::park();
            },
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_millis(20);

    fn words(supervisor: &Supervisor) -> String {
        supervisor.check_threads().expect_err("a fault").to_string()
    }

    #[test]
    fn a_panic_of_an_exempt_thread_is_no_fault() {
        let supervisor = Supervisor::default();
        supervisor.record_all_panics();
        let panics = |is_apart: bool| {
            let thread = std::thread::Builder::new().name("apart".to_owned());
            let run = move || {
                if is_apart {
                    exempt_thread();
                }
                panic!("as it was asked to");
            };
            drop(thread.spawn(run).expect("a thread").join());
        };
        panics(true);
        // Other tests panic at the same time, in threads of other names.
        let is_recorded = || supervisor.lock().panicked.as_deref() == Some("apart");
        assert!(!is_recorded());
        supervisor.lock().panicked = None;
        panics(false);
        assert!(is_recorded() || supervisor.check_threads().is_err());
    }

    #[test]
    fn a_working_thread_that_is_silent_for_too_long_is_a_fault() {
        let supervisor = Supervisor::default();
        let (thread, watched) = supervise("link", LIMIT);
        supervisor.add_thread(watched);
        std::thread::sleep(2 * LIMIT);
        assert_eq!(supervisor.check_threads(), Ok(()), "it has no work yet");
        thread.report_working();
        assert_eq!(supervisor.check_threads(), Ok(()));
        std::thread::sleep(2 * LIMIT);
        assert!(words(&supervisor).contains("the thread \"link\" has not responded for 0.0"));
        thread.report_working();
        assert_eq!(supervisor.check_threads(), Ok(()));
        thread.report_resting();
        std::thread::sleep(2 * LIMIT);
        assert_eq!(supervisor.check_threads(), Ok(()));
    }

    #[test]
    fn a_thread_that_ends_without_a_request_is_a_fault() {
        let supervisor = Supervisor::default();
        let (thread, watched) = supervise("socket", Duration::MAX);
        supervisor.add_thread(watched);
        thread.report_working();
        drop(thread);
        assert!(words(&supervisor).contains("\"socket\" ended unexpectedly"));

        let supervisor = Supervisor::default();
        let (thread, watched) = supervise("recorder", Duration::MAX);
        supervisor.add_thread(watched);
        thread.report_done();
        drop(thread);
        assert_eq!(supervisor.check_threads(), Ok(()));
    }

    /// A panic is a fault even if the thread's runtime catches it.
    #[test]
    fn a_panic_is_a_fault_in_every_thread() {
        let supervisor = Supervisor::default();
        let (one, other) = (supervisor.clone(), Supervisor::default());
        supervisor.record_panic("connection");
        assert!(words(&one).contains("\"connection\" panicked") && other.check_threads().is_ok());
    }
}
