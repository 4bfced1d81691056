//! SIGINT and SIGTERM at a command that moves the robot: the first one stops, the second one aborts.

use super::fault::Fault;
use panelprep_devices::robot::StopLine;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::register_conditional_default;
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// The number of signals received. Clones share the same count.
#[derive(Debug, Clone, Default)]
pub struct Interrupts {
    count: Arc<AtomicUsize>,
    is_ended: Arc<AtomicBool>,
    stop_line: Arc<OnceLock<StopLine>>,
}

impl Interrupts {
    /// Counts the signals from now on, instead of ending the program.
    ///
    /// # Errors
    /// If the operating system cannot provide a thread or a handler.
    pub fn count_signals() -> Result<Self, Fault> {
        let interrupts = Interrupts::default();
        for signal in [SIGINT, SIGTERM] {
            register_conditional_default(signal, interrupts.is_ended.clone()).map_err(Fault::stage)?;
        }
        let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Fault::stage)?;
        let watched = interrupts.clone();
        let each = move || {
            for _ in signals.forever() {
                // Counted first, so that the loop knows the cause when the robot reports that it has stopped.
                watched.count.fetch_add(1, Ordering::SeqCst);
                if let Some(line) = watched.stop_line.get() {
                    line.stop();
                }
            }
        };
        std::thread::Builder::new().name("signals".to_owned()).spawn(each).map_err(Fault::stage)?;
        Ok(interrupts)
    }

    /// Sets the line by which each signal stops the robot at once, also while the loop waits for its disk. Only the
    /// first line that is set is used.
    pub fn stops_by(&self, line: StopLine) {
        #[expect(clippy::let_underscore_must_use, reason = "a program has one robot")]
        let _ = self.stop_line.set(line);
    }

    /// Returns the number of interrupts received.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::SeqCst)
    }

    /// Counts one more interrupt.
    #[cfg(test)]
    pub fn one_came(&self) {
        self.count.fetch_add(1, Ordering::SeqCst);
    }

    /// Ends the special handling, once the robot is no longer in use: from now on a signal ends the program at
    /// once.
    pub fn end_handling(&self) {
        self.is_ended.store(true, Ordering::Relaxed);
    }
}
