//! From the loop to the disk: a bounded queue and the thread that empties it.
//!
//! Where time is the robot's own (lock step), a full queue is waited for: nobody keeps time. By the wall clock nobody
//! waits: what finds no place is counted, and the recording says that it has a gap. A disk that refuses ends the
//! recording and nothing else.

use crate::tape::{Ending, Entry, Lost, Start, TapeError, Topic, Writer};
use std::collections::VecDeque;
use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pictures and points that wait to be packed, bytes: some seconds of film at full size.
const MOST_BYTES: usize = 256 << 20;
/// An entry without a picture takes about this much, bytes.
const LINE_BYTES: usize = 512;
/// What was written is whole on the disk after this time, whatever comes then.
const FLUSH: Duration = Duration::from_secs(1);

/// Where entries are put; any thread may.
#[derive(Debug, Clone)]
pub struct Recorder(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    inside: Mutex<Inside>,
    changed: Condvar,
    waits: bool,
    most_bytes: usize,
}

#[derive(Debug, Default)]
struct Inside {
    waiting: VecDeque<Entry>,
    bytes: usize,
    now_ns: u64,
    lost: Vec<Lost>,
    /// Nothing more will come.
    closed: bool,
    /// Nothing more can be written.
    broken: bool,
}

/// A recording under way; [`Recording::finish`] ends it. One that is dropped is left unfinished, as by a crash.
#[derive(Debug)]
pub struct Recording {
    recorder: Recorder,
    thread: JoinHandle<Result<u64, TapeError>>,
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Entries in the file.
    pub entries: u64,
    /// What is missing in it.
    pub lost: Vec<Lost>,
}

impl Recording {
    /// Starts the thread that writes to this.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start<W: Write + Send + 'static>(writer: Writer<W>, start: &Start) -> std::io::Result<Self> {
        Self::bounded(writer, start.lock_step, MOST_BYTES)
    }

    pub(super) fn bounded<W: Write + Send + 'static>(
        writer: Writer<W>,
        waits: bool,
        most_bytes: usize,
    ) -> std::io::Result<Self> {
        let shared = Shared { inside: Mutex::default(), changed: Condvar::new(), waits, most_bytes };
        let recorder = Recorder(Arc::new(shared));
        let from = recorder.clone();
        let write = move || from.0.write_all(writer);
        let thread = std::thread::Builder::new().name("recording".to_owned()).spawn(write)?;
        Ok(Recording { recorder, thread })
    }

    /// Where entries are put.
    pub fn recorder(&self) -> Recorder {
        self.recorder.clone()
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// Where it could not be written whole.
    pub fn finish(self) -> Result<Written, TapeError> {
        self.recorder.0.lock().closed = true;
        self.recorder.0.changed.notify_all();
        let ended = self.thread.join();
        let lost = self.recorder.0.lock().lost.clone();
        match ended {
            Ok(entries) => Ok(Written { entries: entries?, lost }),
            // It was reported where it happened.
            Err(_) => {
                let source = mcap::McapError::Io(std::io::Error::other("the thread that writes it has ended"));
                Err(TapeError::Disk { doing: "written", source })
            }
        }
    }
}

impl Recorder {
    /// Puts an entry down, at the time of the last [`Recorder::clock`].
    pub fn put(&self, mut entry: Entry) {
        let shared = &*self.0;
        let bytes = LINE_BYTES + entry.shot.as_ref().map_or(0, |shot| shot.bytes());
        let mut inside = shared.lock();
        // The first one always finds a place, however large it is.
        while inside.bytes > 0 && inside.bytes + bytes > shared.most_bytes && !inside.broken {
            if !shared.waits {
                let at_ns = inside.now_ns;
                inside.lose(entry.topic, at_ns);
                return;
            }
            inside = shared.changed.wait(inside).unwrap_or_else(PoisonError::into_inner);
        }
        if inside.broken {
            return;
        }
        entry.at_ns = inside.now_ns;
        inside.bytes += bytes;
        inside.waiting.push_back(entry);
        drop(inside);
        shared.changed.notify_all();
    }

    /// What the loop's clock says; true where that is new.
    pub fn clock(&self, now_ns: u64) -> bool {
        let mut inside = self.0.lock();
        let is_new = inside.now_ns != now_ns;
        inside.now_ns = now_ns;
        is_new
    }
}

impl Inside {
    fn lose(&mut self, topic: Topic, from_ns: u64) {
        match self.lost.iter_mut().find(|lost| lost.topic == topic) {
            Some(lost) => lost.count += 1,
            None => self.lost.push(Lost { topic, from_ns, count: 1 }),
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The thread: writes what comes until nothing more does.
    fn write_all<W: Write>(&self, mut writer: Writer<W>) -> Result<u64, TapeError> {
        let written = self.write_each(&mut writer);
        if written.is_err() {
            self.lock().broken = true;
            self.changed.notify_all();
        }
        let entries = written?;
        let lost = self.lock().lost.clone();
        writer.finish(&Ending { lost })?.flush().map_err(disk)?;
        Ok(entries)
    }

    fn write_each<W: Write>(&self, writer: &mut Writer<W>) -> Result<u64, TapeError> {
        let (mut entries, mut flushed) = (0, Instant::now());
        loop {
            let mut inside = self.lock();
            if inside.waiting.is_empty() && !inside.closed {
                let waited = self.changed.wait_timeout(inside, FLUSH).unwrap_or_else(PoisonError::into_inner);
                inside = waited.0;
            }
            let next = inside.waiting.pop_front();
            let is_over = next.is_none() && inside.closed;
            drop(inside);
            if let Some(entry) = next {
                writer.write(&entry)?;
                entries += 1;
                let bytes = LINE_BYTES + entry.shot.as_ref().map_or(0, |shot| shot.bytes());
                self.lock().bytes -= bytes;
                self.changed.notify_all();
            }
            if is_over {
                return Ok(entries);
            }
            if flushed.elapsed() >= FLUSH {
                writer.flush()?;
                flushed = Instant::now();
            }
        }
    }
}

fn disk(error: std::io::Error) -> TapeError {
    TapeError::Disk { doing: "written", source: error.into() }
}
