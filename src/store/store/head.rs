//! The head of the hash chain, in the file `panelprep.head` beside the database.
//!
//! Before a transaction is committed, the file contains the present and the next position of the chain; afterwards it
//! contains the present position. If the program ends between these steps, the position in the database is one of the
//! two, unless another program changed the database. The file contains two copies of 512 bytes each, the size of a disk
//! sector, which is written completely or not at all. The copies are overwritten alternately, so that a full disk does
//! not prevent the write. When the store is closed, the file also contains the SHA-256 of the database file.

use super::chain::{ChainPosition, Hash};
use super::flush;
use super::lease::{WriteQueue, WriteQueueGuard};
use panelprep_cell::files::{content_hash, hex};
use std::fmt::Write as _;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// File name of the head.
pub(super) const FILE: &str = "panelprep.head";
const SLOT_BYTES: usize = 512;
const HEAD_MAGIC: &str = "panelprep head 1";
/// Maximum time to wait until another process has finished its write to the store, as in SQLite.
const LOCK_TIMEOUT: Duration = Duration::from_secs(5);

/// The contents of the head file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    /// The present end of the hash chain: number and hash of its last row.
    pub position: ChainPosition,
    /// The position of the chain after the transaction in progress is committed.
    pub next_position: Option<ChainPosition>,
    /// SHA-256 of the database file; `None` while the store is open.
    pub database: Option<Hash>,
}

impl Head {
    /// Returns whether this is one of the positions in the head.
    pub fn allows_position(&self, place: ChainPosition) -> bool {
        place == self.position || Some(place) == self.next_position
    }
}

/// The newest valid contents of a head file, and whether the file is damaged.
#[derive(Debug, Clone, Copy)]
pub(super) struct HeadRead {
    pub head: Head,
    /// Whether one of the two copies in the file is damaged.
    pub is_damaged: bool,
    count: u64,
}

/// The head file, open for writing.
#[derive(Debug)]
pub(super) struct HeadFile {
    file: File,
    turns: Arc<WriteQueue>,
}

/// The lock for writing to the chain. Other threads and processes wait until it is released.
pub(super) struct ChainWriteGuard<'f> {
    file: &'f File,
    // This field is dropped after the file lock is released.
    _in_turn: WriteQueueGuard<'f>,
}

impl Drop for ChainWriteGuard<'_> {
    fn drop(&mut self) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the file closes with the store, which also releases a lock that could not be released here"
        )]
        let _ = self.file.unlock();
    }
}

/// Acquires the lock for writing to the chain; waits until it is free.
fn acquire_write_guard<'f>(file: &'f File, turns: &'f WriteQueue) -> Result<ChainWriteGuard<'f>, Error> {
    let since = Instant::now();
    let _in_turn = turns.acquire(LOCK_TIMEOUT).ok_or_else(|| {
        Error::new(ErrorKind::TimedOut, "another thread of this program has held the lock for 5 s")
    })?;
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(ChainWriteGuard { file, _in_turn }),
            Err(TryLockError::WouldBlock) if since.elapsed() < LOCK_TIMEOUT => {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err(TryLockError::WouldBlock) => {
                return Err(Error::new(ErrorKind::TimedOut, "another process has held the lock for 5 s"));
            }
            Err(TryLockError::Error(error)) => return Err(error),
        }
    }
}

impl HeadFile {
    /// Opens the head file; creates it if it does not exist.
    pub fn open(store: &Path) -> Result<Self, Error> {
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(store.join(FILE))?;
        if file.metadata()?.len() < 2 * SLOT_BYTES as u64 {
            // Allocate the disk space of the file now, because the disk may be full later.
            file.write_all_at(&[b'\n'; 2 * SLOT_BYTES], 0)?;
            file.sync_all()?;
            flush::flush_folder(store)?;
        }
        Ok(HeadFile { file, turns: WriteQueue::for_folder(store) })
    }

    pub fn acquire_write_guard(&self) -> Result<ChainWriteGuard<'_>, Error> {
        acquire_write_guard(&self.file, &self.turns)
    }

    /// Writes and flushes the present and the next position of the chain.
    pub fn prepare(&self, at: ChainPosition, next: ChainPosition) -> Result<(), Error> {
        self.write(Head { position: at, next_position: Some(next), database: None })?;
        self.file.sync_data()
    }

    /// Writes the position of the chain without flushing it; the flushed copy already contains it as the possible next
    /// position.
    pub fn write_position(&self, at: ChainPosition) -> Result<(), Error> {
        self.write(Head { position: at, next_position: None, database: None })
    }

    /// Writes the position of the chain and the hash of the database file, when the store is closed.
    pub fn close(&self, at: ChainPosition, database: Option<Hash>) -> Result<(), Error> {
        self.write(Head { position: at, next_position: None, database })?;
        self.file.sync_data()
    }

    fn write(&self, head: Head) -> Result<(), Error> {
        let count = read_head(&self.file)?.map_or(1, |read| read.count + 1);
        // The two copies are overwritten alternately, so that a power failure during a write damages only the older
        // copy.
        let slot = (count % 2) * SLOT_BYTES as u64;
        self.file.write_all_at(&encode_head(&head, count), slot)
    }
}

/// Reads the head file of this store; `None` if the file does not exist, or has no contents yet.
pub(super) fn read(store: &Path) -> Result<Option<HeadRead>, Error> {
    match File::open(store.join(FILE)) {
        Ok(file) => read_head(&file),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Reads the head file of this store and calls `beside`, while no other process or thread writes to the chain.
pub(super) fn read_locked<T>(store: &Path, beside: impl FnOnce() -> T) -> Result<(Option<HeadRead>, T), Error> {
    match File::open(store.join(FILE)) {
        Ok(file) => {
            let turns = WriteQueue::for_folder(store);
            let _turn = acquire_write_guard(&file, &turns)?;
            Ok((read_head(&file)?, beside()))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => Ok((None, beside())),
        Err(error) => Err(error),
    }
}

fn read_head(file: &File) -> Result<Option<HeadRead>, Error> {
    let mut bytes = Vec::with_capacity(2 * SLOT_BYTES);
    let mut buffer = [0; 2 * SLOT_BYTES + 1];
    let count = file.read_at(&mut buffer, 0)?;
    bytes.extend_from_slice(&buffer[..count]);
    let slots: Vec<Option<(u64, Head)>> = bytes.chunks(SLOT_BYTES).map(parse_slot).collect();
    let blank = bytes.chunks(SLOT_BYTES).filter(|slot| slot.iter().all(|byte| *byte == b'\n')).count();
    let newest = slots.iter().flatten().max_by_key(|(count, _)| *count);
    let is_damaged = bytes.len() != 2 * SLOT_BYTES || slots.iter().flatten().count() + blank != slots.len();
    match newest {
        Some((count, head)) => Ok(Some(HeadRead { head: *head, is_damaged, count: *count })),
        None if !is_damaged || bytes.is_empty() => Ok(None),
        // An empty file may belong to a new store. A file with two damaged copies does not, and must not be treated as
        // empty.
        None => Err(Error::new(ErrorKind::InvalidData, "both copies in the head file are damaged")),
    }
}

#[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
fn encode_head(head: &Head, count: u64) -> Vec<u8> {
    let place = |place: &ChainPosition| format!("{} {}", place.link, hex(&place.hash));
    let mut text = format!("{HEAD_MAGIC}\ncount {count}\nat {}\n", place(&head.position));
    let _ = writeln!(text, "next {}", head.next_position.as_ref().map_or("none".to_owned(), place));
    let _ = writeln!(text, "database {}", head.database.as_ref().map_or("none".to_owned(), |hash| hex(hash)));
    let check = content_hash(text.as_bytes());
    let _ = write!(text, "check {check}");
    let mut bytes = text.into_bytes();
    bytes.resize(SLOT_BYTES, b'\n');
    bytes
}

fn parse_slot(slot: &[u8]) -> Option<(u64, Head)> {
    let text = std::str::from_utf8(slot).ok()?;
    let (said, check) = text.split_once("check ")?;
    // The padding is checked too, so that a change of any byte is detected.
    let padded = check.get(64..)?.bytes().all(|byte| byte == b'\n');
    if slot.len() != SLOT_BYTES || !padded || content_hash(said.as_bytes()) != check.get(..64)? {
        return None;
    }
    let mut lines = said.lines();
    (lines.next()? == HEAD_MAGIC).then_some(())?;
    let count = lines.next()?.strip_prefix("count ")?.parse().ok()?;
    let at = parse_position(lines.next()?.strip_prefix("at ")?)?;
    let next = parse_optional(lines.next()?.strip_prefix("next ")?, parse_position)?;
    let database = parse_optional(lines.next()?.strip_prefix("database ")?, bytes)?;
    lines.next().is_none().then_some((count, Head { position: at, next_position: next, database }))
}

fn parse_optional<T>(text: &str, parse: impl Fn(&str) -> Option<T>) -> Option<Option<T>> {
    if text == "none" { Some(None) } else { parse(text).map(Some) }
}

fn parse_position(text: &str) -> Option<ChainPosition> {
    let (link, hash) = text.split_once(' ')?;
    Some(ChainPosition { link: link.parse().ok()?, hash: bytes(hash)? })
}

fn bytes(text: &str) -> Option<Hash> {
    let digit = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let bytes: Option<Vec<u8>> = text.as_bytes().chunks(2).map(digit).collect();
    bytes?.try_into().ok()
}
