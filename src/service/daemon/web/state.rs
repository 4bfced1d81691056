//! Data that the handlers of the page share, with the last picture of each camera that was captured between cycles, and
//! the maximum number of connections, from one address and in total.
//!
//! [`Refusals`] limits the entries of the audit trail about refused requests of logged-in people. If a page repeats
//! such requests, only a few entries are written, and one further entry with the number of the others, so that requests
//! without permission do not keep the disk busy.

use super::live_state::{FrameEncoder, LiveState};
use super::page_texts::{Language, Translations};
use super::sessions::{AccountStamps, Sessions, Visitor};
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::live_view::LiveScene;
use crate::daemon::slots::{MaxConnections, Slots};
use panelprep_cell::accounts::{AuditEntry, LineLimit, MaxLinesPerMinute};
use panelprep_devices::cameras::{Conditions, PictureQuality};
use panelprep_store::store::{Store, StoreError};
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Semaphore, watch};

/// Data that the handlers of the page share.
pub(super) struct Web {
    pub front: InterfaceContext,
    pub live: watch::Receiver<Arc<LiveState>>,
    pub frames: Arc<FrameEncoder>,
    pub scene: LiveScene,
    pub translations: Arc<Translations>,
    /// Whether the page uses TLS.
    pub is_tls: bool,
    /// The host names that a page without TLS accepts in requests.
    pub hosts: Option<[String; 2]>,
    /// Allows one examination of the whole cell at a time.
    pub examining: Semaphore,
    /// The last pictures of the cameras between cycles.
    pub views: CameraShots,
    /// The connections that receive the events.
    pub viewer_slots: ViewerSlots,
    /// The account stamps as of the last reading.
    pub stamps: AccountStamps,
    /// Locked while a recipe is saved.
    pub saving: Mutex<()>,
    refusals: Mutex<Refusals>,
    sessions: Mutex<Sessions>,
}

/// The parts from which the shared data of the page are created.
pub(super) struct WebParts {
    pub front: InterfaceContext,
    pub live: watch::Receiver<Arc<LiveState>>,
    pub frames: Arc<FrameEncoder>,
    pub translations: Translations,
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

    /// Returns the time of a monotonic clock, s.
    pub fn now_s(&self) -> f64 {
        self.front.people.now_s()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an entry about a refused request to the audit trail, or only counts it if there are many. The call blocks
    /// while it waits for the disk.
    pub fn audit_refusal(&self, line: &AuditEntry) {
        let now_ms = self.now_ms();
        self.count_refusals(now_ms);
        if self.lock_refusals().admit_line(line, now_ms) {
            self.audit(line);
        }
    }

    /// Writes the number of refusals without an entry for the minutes that have ended. The call blocks while it waits
    /// for the disk.
    pub fn count_refusals(&self, now_ms: u64) {
        let counted = self.lock_refusals().take_elapsed_lines(now_ms);
        counted.iter().for_each(|line| self.audit(line));
    }

    fn lock_refusals(&self) -> MutexGuard<'_, Refusals> {
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.refusals.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the time of the clock of [`Web::now_s`], ms.
    pub fn now_ms(&self) -> u64 {
        (self.now_s() * 1_000.0) as u64
    }

    /// Opens the store and reads from it. The call blocks while it waits for the disk.
    ///
    /// # Errors
    /// If the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.front.people.read(read)
    }

    /// Opens the store and writes to it. The call blocks while it waits for the disk; no cycle waits for it.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.front.people.write(write)
    }

    /// Adds an entry to the audit trail; if the disk cannot be written, the entry is written to the service's log.
    pub fn audit(&self, entry: &AuditEntry) {
        self.front.people.audit(entry);
    }
}

/// The last picture of a camera that a person requested on the page.
pub(super) struct CameraShot {
    pub jpeg: Vec<u8>,
    pub unix_ms: i64,
    pub size_px: [usize; 2],
    pub quality: PictureQuality,
    pub conditions: Conditions,
}

/// The last picture of each camera.
#[derive(Default)]
pub(super) struct CameraShots([Mutex<Option<Arc<CameraShot>>>; 2]);

impl CameraShots {
    fn lock_slot(&self, at: usize) -> MutexGuard<'_, Option<Arc<CameraShot>>> {
        self.0[at].lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn store(&self, at: usize, view: CameraShot) {
        *self.lock_slot(at) = Some(Arc::new(view));
    }

    pub fn last_shot(&self, at: usize) -> Option<Arc<CameraShot>> {
        self.lock_slot(at).clone()
    }
}

/// Maximum number of entries of one account per minute; one further entry contains the number of the others.
const MAX_ENTRIES_PER_MINUTE: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 19 };

/// For each account with refused requests in this minute: the limit of its entries, and the last entry.
#[derive(Debug, Default)]
pub(super) struct Refusals(BTreeMap<String, (LineLimit, AuditEntry)>);

impl Refusals {
    /// Returns whether the entry about a refusal must be written; if not, it is counted.
    pub fn admit_line(&mut self, line: &AuditEntry, now_ms: u64) -> bool {
        let who = line.who.clone().unwrap_or_default();
        let (limit, last) =
            self.0.entry(who).or_insert_with(|| (LineLimit::new(MAX_ENTRIES_PER_MINUTE, now_ms), line.clone()));
        last.clone_from(line);
        limit.admit_line(true)
    }

    /// Returns, for the minutes that have ended, the entries with the number of refusals without an entry.
    pub fn take_elapsed_lines(&mut self, now_ms: u64) -> Vec<AuditEntry> {
        let mut counted = Vec::new();
        self.0.retain(|_, (limit, last)| {
            let is_over = limit.has_minute_elapsed(now_ms);
            if let Some(left_out) = limit.end_elapsed_minute(now_ms) {
                let refused =
                    format!("{left_out} further refused requests within one minute were not recorded individually");
                let AuditEntry { who, role, from, .. } = last.clone();
                counted.push(AuditEntry {
                    refused: Some(refused),
                    ..AuditEntry::for_completed_action(who, role, from, "flood")
                });
            }
            !is_over
        });
        counted
    }
}

/// Maximum number of simultaneous connections. If all are in use, the one that has been silent for the longest time is
/// closed for a new one.
pub(super) const MAX_PAGE_CONNECTIONS: MaxConnections = MaxConnections { per_owner: 256, total: 512 };
/// Maximum number of connections among these that may receive the events, a response without an end. The other
/// connections remain free for requests: even with the maximum number of viewers, 320 of 512 connections can be used
/// for a stop, and 192 of one address.
const MAX_VIEWERS: MaxConnections = MaxConnections { per_owner: 64, total: 192 };

/// The connections that receive the events, by their owners.
pub(super) type ViewerSlots = Slots<IpAddr>;

/// Returns the text that log-ins to the account are blocked for this number of seconds after wrong passwords.
pub(super) fn lock_text(left_s: f64, words: Language<'_>) -> String {
    format!("{} {:.0} s", words.text("login.pauses"), left_s.ceil())
}

/// Returns an entry of the audit trail for an action of this visitor.
pub(super) fn entry(visitor: &Visitor, what: &str) -> AuditEntry {
    let (who, role) = visitor.person.as_ref().map(|person| (person.name.clone(), person.role)).unzip();
    AuditEntry::for_completed_action(who, role, visitor.from.clone(), what)
}

/// Runs work that may wait for a disk or take long, outside of the page's runtime.
pub(super) async fn run_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(work).await.ok()
}

/// Runs work with passwords, one task at a time, outside of the page's runtime.
pub(super) async fn hashing<T: Send + 'static>(web: &Web, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    web.front.people.hashing(work).await
}

/// Returns the owner of a connection from this address: the address itself for IPv4, the network for IPv6, because the
/// hosts of an IPv6 network choose their addresses freely.
pub(super) fn connection_owner(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(address) => IpAddr::V4(address),
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_of_ipv6_is_one_owner() {
        let of = |text: &str| connection_owner(text.parse().expect("an address"));
        assert_eq!(of("2001:db8::1"), of("2001:db8::ffff:7"));
        assert_ne!(of("2001:db8::1"), of("2001:db8:0:1::1"));
        assert_eq!(of("::ffff:10.0.0.1"), of("10.0.0.1"));
        assert_ne!(of("10.0.0.1"), of("10.0.0.2"));
    }
}
