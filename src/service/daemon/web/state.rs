//! Data that the page's handlers share.

use super::camera_views::CameraShots;
use super::frame::FrameEncoder;
use super::live_state::LiveState;
use super::page_texts::{Language, Translations};
use super::places::{MAX_VIEWERS, ViewerSlots};
use super::refusals::Refusals;
use super::sessions::Sessions;
use super::stamps::AccountStamps;
use super::visitor::Visitor;
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::live_view::LiveScene;
use crate::daemon::sources::RecordSource;
use panelprep_cell::accounts::AuditEntry;
use panelprep_store::store::{Store, StoreError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Semaphore, watch};

/// Data that the page's handlers share.
pub(super) struct Web {
    pub front: InterfaceContext,
    pub live: watch::Receiver<Arc<LiveState>>,
    pub frames: Arc<FrameEncoder>,
    pub scene: LiveScene,
    pub translations: Arc<Translations>,
    pub records: Arc<dyn RecordSource>,
    /// Whether the page uses TLS.
    pub is_tls: bool,
    /// The host names under which a page without TLS may be requested.
    pub hosts: Option<[String; 2]>,
    /// Locked while a person runs an examination of the whole cell.
    pub examining: Semaphore,
    /// The last pictures of the cameras between cycles.
    pub views: CameraShots,
    /// The viewers of the events.
    pub viewer_slots: ViewerSlots,
    /// The accounts as they were read last.
    pub stamps: AccountStamps,
    /// Held while a recipe is saved.
    pub saving: Mutex<()>,
    refusals: Mutex<Refusals>,
    sessions: Mutex<Sessions>,
}

/// The parts from which the shared data of the page is made.
pub(super) struct WebParts {
    pub front: InterfaceContext,
    pub live: watch::Receiver<Arc<LiveState>>,
    pub frames: Arc<FrameEncoder>,
    pub translations: Translations,
    pub records: Arc<dyn RecordSource>,
    pub is_tls: bool,
    pub hosts: Option<[String; 2]>,
    pub idle_min: usize,
    pub sessions: usize,
}

impl Web {
    pub fn new(parts: WebParts) -> Self {
        let idle_s = parts.idle_min as f64 * 60.0;
        Web {
            front: parts.front,
            live: parts.live,
            scene: parts.frames.scene(),
            frames: parts.frames,
            translations: Arc::new(parts.translations),
            records: parts.records,
            is_tls: parts.is_tls,
            hosts: parts.hosts,
            examining: Semaphore::new(1),
            views: CameraShots::default(),
            viewer_slots: ViewerSlots::new(MAX_VIEWERS),
            stamps: AccountStamps::default(),
            saving: Mutex::default(),
            refusals: Mutex::default(),
            sessions: Mutex::new(Sessions::new(idle_s, parts.sessions)),
        }
    }

    /// Returns the seconds on a clock that does not jump.
    pub fn now_s(&self) -> f64 {
        self.front.people.now_s()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        // Every change is completed under the lock.
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a line of the audit trail about a refused request, or counts it if there are many; on the calling
    /// thread.
    pub fn audit_refusal(&self, line: &AuditEntry) {
        let now_ms = self.now_ms();
        self.count_refusals(now_ms);
        if self.lock_refusals().admit_line(line, now_ms) {
            self.audit(line);
        }
    }

    /// Records the lines that count the refusals of the minutes that have passed by this time. It runs on the calling
    /// thread.
    pub fn count_refusals(&self, now_ms: u64) {
        let counted = self.lock_refusals().take_elapsed_lines(now_ms);
        counted.iter().for_each(|line| self.audit(line));
    }

    fn lock_refusals(&self) -> MutexGuard<'_, Refusals> {
        // Every change is completed under the lock.
        self.refusals.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the milliseconds on the clock of [`Web::now_s`].
    pub fn now_ms(&self) -> u64 {
        (self.now_s() * 1_000.0) as u64
    }

    /// Reads the store on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// If the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.front.people.read(read)
    }

    /// Writes a row for which no cycle waits, on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.front.people.write(write)
    }

    /// Writes a line of the audit trail; if the disk refuses, the line is written to the service's log.
    pub fn audit(&self, entry: &AuditEntry) {
        self.front.people.audit(entry);
    }
}

/// Returns the text that log-in to the account is blocked for this many more seconds after wrong passwords.
pub(super) fn pauses(left_s: f64, words: Language<'_>) -> String {
    format!("{} {:.0} s", words.text("login.pauses"), left_s.ceil())
}

/// Returns a line of the audit trail for this visitor and an action that was done.
pub(super) fn entry(visitor: &Visitor, what: &str) -> AuditEntry {
    let (who, role) = visitor.person.as_ref().map(|person| (person.name.clone(), person.role)).unzip();
    AuditEntry::for_completed_action(who, role, visitor.from.clone(), what)
}

/// Runs work that may wait for a disk or need long, outside the page's runtime.
pub(super) async fn run_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(work).await.ok()
}

/// Does work with passwords, one task at a time, outside of the page's runtime.
pub(super) async fn hashing<T: Send + 'static>(web: &Web, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    web.front.people.hashing(work).await
}
