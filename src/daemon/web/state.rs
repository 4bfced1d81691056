//! What the page's handlers share.

use super::camera_views::Views;
use super::frame::Frames;
use super::live_state::Live;
use super::record_source::RecordSource;
use super::sessions::Sessions;
use super::setup_source::SetupSource;
use super::standing::Standing;
use super::visitor::Visitor;
use super::words::{Language, Words};
use crate::accounts::{AuditEntry, Lockout};
use crate::daemon::gateway::Gateway;
use crate::daemon::live_scene::LiveScene;
use crate::store::{Store, StoreError};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Instant;
use tokio::sync::{Semaphore, oneshot, watch};

/// What the page's handlers share.
pub(super) struct Web {
    pub gateway: Gateway,
    pub live: watch::Receiver<Arc<Live>>,
    pub frames: Arc<Frames>,
    pub scene: LiveScene,
    pub words: Arc<Words>,
    pub setup: Arc<dyn SetupSource>,
    pub records: Arc<dyn RecordSource>,
    /// Whether the page goes by TLS.
    pub is_tls: bool,
    /// The hosts by which a page without TLS may be asked for.
    pub hosts: Option<[String; 2]>,
    hashing: Semaphore,
    /// Whoever has the cell looked at from the bottom up.
    pub examining: Semaphore,
    /// What the cameras saw last between cycles.
    pub views: Views,
    /// Alarms between cycles.
    pub standing: Standing,
    pub folder: PathBuf,
    sessions: Mutex<Sessions>,
    lockout: Mutex<Lockout>,
    reader: Mutex<Option<Store>>,
    writer: Mutex<Option<Store>>,
    begun: Instant,
}

/// What a page is made with.
pub(super) struct WebParts {
    pub gateway: Gateway,
    pub live: watch::Receiver<Arc<Live>>,
    pub frames: Arc<Frames>,
    pub words: Words,
    pub setup: Arc<dyn SetupSource>,
    pub records: Arc<dyn RecordSource>,
    pub is_tls: bool,
    pub hosts: Option<[String; 2]>,
    pub folder: PathBuf,
    pub idle_min: usize,
    pub sessions: usize,
}

impl Web {
    pub fn new(parts: WebParts) -> Self {
        let idle_s = parts.idle_min as f64 * 60.0;
        Web {
            gateway: parts.gateway,
            live: parts.live,
            scene: parts.frames.scene(),
            frames: parts.frames,
            words: Arc::new(parts.words),
            setup: parts.setup,
            records: parts.records,
            is_tls: parts.is_tls,
            hosts: parts.hosts,
            hashing: Semaphore::new(1),
            examining: Semaphore::new(1),
            views: Views::default(),
            standing: Standing::default(),
            folder: parts.folder,
            sessions: Mutex::new(Sessions::new(idle_s, parts.sessions)),
            lockout: Mutex::default(),
            reader: Mutex::default(),
            writer: Mutex::default(),
            begun: Instant::now(),
        }
    }

    /// Seconds on a clock that does not jump.
    pub fn now_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        lock(&self.sessions)
    }

    pub fn lockout(&self) -> MutexGuard<'_, Lockout> {
        lock(&self.lockout)
    }

    /// In which words this account's password may not be tried now, after wrong ones.
    pub fn pauses(&self, name: &str, words: Language<'_>) -> Option<String> {
        let left_s = self.lockout().pauses_s(name, self.now_s())?;
        Some(format!("{} {:.0} s", words.word("login.pauses"), left_s.ceil()))
    }

    /// Reads the store, on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// Where the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut reader = lock(&self.reader);
        let store = match reader.take() {
            Some(store) => store,
            None => Store::open(&self.folder)?,
        };
        let result = read(&store);
        *reader = Some(store);
        result
    }

    /// Writes a row that no cycle waits for, on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// Where the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut writer = lock(&self.writer);
        let mut store = match writer.take() {
            Some(store) => store,
            None => Store::for_people(&self.folder)?,
        };
        let result = write(&mut store);
        *writer = Some(store);
        result
    }

    /// Keeps a line of the audit trail; where the disk refuses, the service's log has it.
    pub fn audit(&self, entry: &AuditEntry) {
        if let Err(error) = self.write(|store| store.keep_audit(entry)) {
            let (what, who) = (&entry.what, entry.who.as_deref().unwrap_or("nobody who is logged in"));
            tracing::warn!("the audit trail could not be written: {error}; {what} by {who}");
        }
    }
}

/// A line of the audit trail about this visitor, done.
pub(super) fn entry(visitor: &Visitor, what: &str) -> AuditEntry {
    let person = visitor.person.as_ref();
    AuditEntry {
        unix_ms: 0,
        who: person.map(|person| person.name.clone()),
        role: person.map(|person| person.role),
        from: visitor.from.clone(),
        what: what.to_owned(),
        subject: None,
        before: None,
        after: None,
        refused: None,
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Every change is made whole under the lock.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs work that may wait for a disk or take long beside the page's runtime.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(work).await.ok()
}

/// Works with passwords, one at a time, on a thread that ends with it: a hash takes 19 MiB and most of a processor, and each
/// thread that lives on would keep as much.
pub(super) async fn hashing<T: Send + 'static>(web: &Web, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    let _turn = web.hashing.acquire().await.ok()?;
    let (tell, told) = oneshot::channel();
    let hash = move || drop(tell.send(work()));
    thread::Builder::new().name("password".to_owned()).spawn(hash).ok()?;
    told.await.ok()
}
