//! SIGINT and SIGTERM at a command that moves the robot: the first one stops, the second one aborts.

use super::fault::Fault;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::register_conditional_default;
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The number of signals received. Clones share the same count.
#[derive(Debug, Clone, Default)]
pub struct Interrupts {
    count: Arc<AtomicUsize>,
    is_over: Arc<AtomicBool>,
}

impl Interrupts {
    /// Counts the signals from now on, instead of ending the program.
    ///
    /// # Errors
    /// If the operating system cannot provide a thread or a handler.
    pub fn watch() -> Result<Self, Fault> {
        let interrupts = Interrupts::default();
        for signal in [SIGINT, SIGTERM] {
            register_conditional_default(signal, interrupts.is_over.clone()).map_err(Fault::stage)?;
        }
        let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Fault::stage)?;
        let count = interrupts.count.clone();
        let each = move || {
            for _ in signals.forever() {
                count.fetch_add(1, Ordering::Relaxed);
            }
        };
        std::thread::Builder::new().name("signals".to_owned()).spawn(each).map_err(Fault::stage)?;
        Ok(interrupts)
    }

    /// How many came.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }

    /// One more came.
    #[cfg(test)]
    pub fn one_came(&self) {
        self.count.fetch_add(1, Ordering::Relaxed);
    }

    /// Ends the special handling, once the robot is no longer in use: from now on a signal ends the program at
    /// once.
    pub fn are_over(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}
