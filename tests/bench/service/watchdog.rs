//! systemd's side of the watchdog: a datagram socket, and the longest interval between two notifications.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The value of `WatchdogSec` in `config/panelprep.service`.
pub const WATCHDOG_TIMEOUT: Duration = Duration::from_secs(10);

#[derive(Debug, Default)]
struct WatchdogStats {
    signs: u64,
    last: Option<Instant>,
    largest_gap: Duration,
}

/// Statistics of the notifications that were received so far.
#[derive(Debug, Clone, Default)]
pub struct Watchdog(Arc<Mutex<WatchdogStats>>);

impl Watchdog {
    /// Listens at this path until the program ends. The time is recorded when a datagram is read; a late reader only
    /// makes one interval longer and the next one shorter.
    pub fn listen(path: &Path) -> Self {
        let socket = UnixDatagram::bind(path).expect("a socket");
        let watchdog = Watchdog::default();
        let heard = watchdog.clone();
        std::thread::spawn(move || {
            let mut bytes = [0; 4_096];
            while let Ok(count) = socket.recv(&mut bytes) {
                let text = String::from_utf8_lossy(&bytes[..count]);
                // systemd measures the first interval from the moment at which the service is ready.
                if text.lines().any(|line| line == "WATCHDOG=1" || line == "READY=1") {
                    heard.record(Instant::now());
                }
            }
        });
        watchdog
    }

    fn record(&self, now: Instant) {
        let mut heard = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        heard.signs += 1;
        heard.largest_gap = heard.largest_gap.max(heard.last.map_or(Duration::ZERO, |last| now - last));
        heard.last = Some(now);
    }

    pub fn signs(&self) -> u64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).signs
    }

    /// Returns the longest interval between two notifications, including the present one.
    pub fn largest_gap(&self) -> Duration {
        let heard = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        heard.largest_gap.max(heard.last.map_or(Duration::ZERO, |last| last.elapsed()))
    }
}
