//! Transfer of the recorded data from the loop to the disk: a bounded queue, and the thread that empties it.
//!
//! In lock step, no clock runs while the loop waits; therefore the loop waits while the queue is full, as long as the
//! disk accepts data. With the wall clock the loop never waits: an entry for which the queue has no space is counted,
//! and the recording states that it has a gap. If the disk refuses data, or has too little free space, only the
//! recording ends.

use super::super::computing::NICE;
use crate::setup::{MIN_FREE_SPACE_FOR_RECORDING_MB, RecordingResult, RecordingStatus, disk_full_message};
use panelprep_base::supervision::SupervisedThread;
use panelprep_store::tape::{Entry, LostEntries, RecordingEnd, Shot, TapeError, Topic, Writer};
use serde_json::Value;
use std::collections::VecDeque;
use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Largest amount of pictures and points that wait to be compressed, bytes: some seconds of film at full size.
const MAX_QUEUED_BYTES: usize = 256 << 20;
/// Approximate size of a number, a word, a list or an object in an entry, bytes.
const VALUE_BYTES: usize = 100;
/// Interval at which written data are flushed to the disk and the free space is checked.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum time to wait for a disk that accepts no data: for space in the queue, and below it at the end.
const DISK_TIMEOUT: Duration = Duration::from_secs(2);
const CLOSE_TIMEOUT: Duration = Duration::from_secs(20);

/// The sending end of the queue; any thread may use it.
#[derive(Debug, Clone)]
pub struct Recorder(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    inside: Mutex<Inside>,
    changed: Condvar,
    bounds: QueueBounds,
    /// The heartbeat of the thread, except while it waits for the disk: a disk that hangs only ends the recording.
    sign: Option<Arc<SupervisedThread>>,
}

/// The size of the queue, and whether the loop waits if the queue is full.
#[derive(Debug, Clone, Copy)]
pub(super) struct QueueBounds {
    pub is_blocking: bool,
    pub max_bytes: usize,
    pub disk_timeout: Duration,
    pub final_disk_timeout: Duration,
}

impl QueueBounds {
    pub fn new(lock_step: bool) -> Self {
        QueueBounds {
            is_blocking: lock_step,
            max_bytes: MAX_QUEUED_BYTES,
            disk_timeout: DISK_TIMEOUT,
            final_disk_timeout: CLOSE_TIMEOUT,
        }
    }
}

#[derive(Debug, Default)]
struct Inside {
    waiting: VecDeque<Entry>,
    bytes: usize,
    /// The time of the loop's clock at the beginning of the recording. The next field is the time since then.
    origin_ns: Option<u64>,
    now_ns: u64,
    lost: Vec<LostEntries>,
    /// Whether the disk has already hung once.
    has_hung: bool,
    /// Whether the queue is closed, so that no further entry will come.
    closed: bool,
    /// The reason why no further entry can be written.
    stopped: Option<String>,
    entries: u64,
    /// Whether the thread has ended.
    ended: bool,
}

/// Measures the free space on the disk of the recording, MB.
pub(super) type FreeSpace = Box<dyn FnMut() -> std::io::Result<u64> + Send>;

/// A recording in progress; [`Recording::finish`] ends it. If this value is dropped instead, the recording is
/// incomplete, as after a crash.
#[derive(Debug)]
pub struct Recording {
    file: String,
    recorder: Recorder,
    thread: JoinHandle<()>,
}

impl Recording {
    /// Starts the thread that creates a file with this name and writes to it.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub(super) fn start<W: Write + Send + 'static>(
        file: String,
        open: impl FnOnce() -> Result<Writer<W>, TapeError> + Send + 'static,
        (bounds, sign): (QueueBounds, Option<Arc<SupervisedThread>>),
        mut room: FreeSpace,
    ) -> std::io::Result<Self> {
        let shared = Shared { inside: Mutex::default(), changed: Condvar::new(), bounds, sign };
        let recorder = Recorder(Arc::new(shared));
        let shared = recorder.0.clone();
        let write = move || {
            // A lost recording is less serious than a delay of the loop, so this thread has the same low priority as
            // the computing thread.
            if !bounds.is_blocking
                && let Err(error) = rustix::process::setpriority_process(None, NICE)
            {
                tracing::warn!("cannot lower the priority of the recording thread: {error}");
            }
            let mut ends = ThreadEndGuard { shared: shared.clone(), panics: true };
            if let Err(error) = open().and_then(|writer| shared.run_writer(writer, &mut room)) {
                shared.lock().stop(error.to_string());
            }
            ends.panics = false;
            if let Some(sign) = &shared.sign {
                sign.report_done();
            }
        };
        let thread = std::thread::Builder::new().name("recording".to_owned()).spawn(write)?;
        Ok(Recording { file, recorder, thread })
    }

    /// Returns the sending end of the queue.
    pub fn recorder(&self) -> Recorder {
        self.recorder.clone()
    }

    /// Returns its status.
    pub fn status(&self) -> RecordingResult {
        self.recorder.status(&self.file)
    }

    /// Ends the recording and waits until it is written, as long as the disk accepts data.
    pub fn finish(self) -> RecordingResult {
        let Recording { file, recorder, thread } = self;
        recorder.close();
        if recorder.wait_for_end() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the recording is incomplete, because its thread panicked (see the earlier message in the \
                          log); record the cycle again"
            )]
            let _ = thread.join();
        }
        recorder.status(&file)
    }
}

/// Records the end of the thread when it is dropped, also after a panic.
struct ThreadEndGuard {
    shared: Arc<Shared>,
    panics: bool,
}

impl Drop for ThreadEndGuard {
    fn drop(&mut self) {
        let mut inside = self.shared.lock();
        inside.ended = true;
        if self.panics {
            inside.stop("the recording thread has ended early; see the log".to_owned());
        }
        drop(inside);
        self.shared.changed.notify_all();
    }
}

impl Recorder {
    /// Adds an entry with the time that was last set by [`Recorder::clock`].
    pub fn record_entry(&self, mut entry: Entry) {
        let shared = &*self.0;
        let QueueBounds { is_blocking: waits, max_bytes: most_bytes, disk_timeout: hangs, .. } = shared.bounds;
        let bytes = size(&entry);
        let mut inside = shared.lock();
        // An empty queue accepts an entry of any size.
        while inside.bytes > 0 && inside.bytes + bytes > most_bytes && inside.is_accepting() {
            if !waits || inside.has_hung {
                let at_ns = inside.now_ns;
                inside.add_lost(entry.topic, at_ns);
                return;
            }
            let waited = shared.changed.wait_timeout(inside, hangs).unwrap_or_else(PoisonError::into_inner);
            inside = waited.0;
            inside.has_hung |= waited.1.timed_out();
        }
        if !inside.is_accepting() {
            return;
        }
        entry.at_ns = inside.now_ns;
        inside.bytes += bytes;
        inside.waiting.push_back(entry);
        drop(inside);
        shared.changed.notify_all();
    }

    /// Records the time of the loop's clock; returns true if the time has changed. The time of the recording begins
    /// with the first call.
    pub fn clock(&self, now_ns: u64) -> bool {
        let mut inside = self.0.lock();
        let is_first = inside.origin_ns.is_none();
        let since_ns = now_ns.saturating_sub(*inside.origin_ns.get_or_insert(now_ns));
        let is_new = is_first || inside.now_ns != since_ns;
        inside.now_ns = since_ns;
        is_new
    }

    /// Returns whether time stops while the caller waits for space in the queue.
    pub(super) fn is_lock_step(&self) -> bool {
        self.0.bounds.is_blocking
    }

    /// Closes the queue: no further entries are accepted.
    pub(super) fn close(&self) {
        self.0.lock().closed = true;
        self.0.changed.notify_all();
    }

    /// Waits for the end of the thread; returns false if the disk hangs and the thread therefore continues to run.
    fn wait_for_end(&self) -> bool {
        let Shared { changed, bounds, .. } = &*self.0;
        let mut inside = self.0.lock();
        while !inside.ended {
            let entries = inside.entries;
            let stands = |inside: &mut Inside| !inside.ended && inside.entries == entries;
            let waited = changed.wait_timeout_while(inside, bounds.final_disk_timeout, stands);
            let (guard, waited) = waited.unwrap_or_else(PoisonError::into_inner);
            inside = guard;
            if waited.timed_out() {
                inside.stop(format!(
                    "the disk of the recording accepted no data for {} s; check the disk",
                    bounds.final_disk_timeout.as_secs_f64()
                ));
                return false;
            }
        }
        true
    }

    /// Returns the status of the recording in this file.
    pub(super) fn status(&self, file: &str) -> RecordingResult {
        let inside = self.0.lock();
        let Inside { entries, lost, stopped, .. } = &*inside;
        let gap = || {
            let lost = lost.iter().map(|lost| format!("{} of {}", lost.count, lost.topic.name()));
            format!("the recording has a gap; not recorded: {}", lost.collect::<Vec<_>>().join(", "))
        };
        let (file, trouble) = (file.to_owned(), stopped.clone().or_else(|| (!lost.is_empty()).then(gap)));
        match trouble {
            Some(why) => RecordingResult { entries: *entries, ..RecordingResult::incomplete_recording(file, &why) },
            None if inside.ended => RecordingResult::complete_recording(file, *entries),
            None => {
                let message = format!("records in {file}");
                RecordingResult { file, is: RecordingStatus::UnderWay, entries: *entries, message }
            }
        }
    }
}

impl Inside {
    fn is_accepting(&self) -> bool {
        !self.closed && self.stopped.is_none()
    }

    fn add_lost(&mut self, topic: Topic, from_ns: u64) {
        match self.lost.iter_mut().find(|lost| lost.topic == topic) {
            Some(lost) => lost.count += 1,
            None => self.lost.push(LostEntries { topic, from_ns, count: 1 }),
        }
    }

    /// Stops the recording, and wakes threads that wait for space in the queue.
    fn stop(&mut self, why: String) {
        if self.stopped.is_none() {
            tracing::warn!("the recording stops: {why}");
            self.stopped = Some(why);
        }
        self.waiting.clear();
        self.bytes = 0;
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the entries until the queue is closed, or until the disk has too little free space.
    fn run_writer<W: Write>(&self, mut writer: Writer<W>, room: &mut FreeSpace) -> Result<(), TapeError> {
        let mut flushed = Instant::now();
        let mut has_room = self.has_free_space(room);
        while has_room && self.write_next(&mut writer)? {
            if flushed.elapsed() >= FLUSH_INTERVAL {
                writer.end_chunk()?;
                flushed = Instant::now();
                has_room = self.has_free_space(room);
            }
        }
        let ending = {
            let inside = self.lock();
            RecordingEnd { lost: inside.lost.clone(), stopped: inside.stopped.clone() }
        };
        writer.finish(&ending)?.flush().map_err(disk)
    }

    /// Returns whether the disk has enough free space; if not, stops the recording.
    fn has_free_space(&self, room: &mut FreeSpace) -> bool {
        if let Some(sign) = &self.sign {
            sign.report_resting();
        }
        let free_mb = match room() {
            // If the free space cannot be measured, the thread continues to write; a full disk returns an error.
            Err(_) => return true,
            Ok(free_mb) if free_mb >= MIN_FREE_SPACE_FOR_RECORDING_MB => return true,
            Ok(free_mb) => free_mb,
        };
        self.lock().stop(disk_full_message(free_mb));
        self.changed.notify_all();
        false
    }

    /// Writes the waiting entries, or waits some time for entries; returns false if no further entry will come.
    fn write_next<W: Write>(&self, writer: &mut Writer<W>) -> Result<bool, TapeError> {
        if let Some(sign) = &self.sign {
            sign.report_working();
        }
        let mut inside = self.lock();
        if inside.waiting.is_empty() && !inside.closed {
            inside = self.changed.wait_timeout(inside, FLUSH_INTERVAL).unwrap_or_else(PoisonError::into_inner).0;
        }
        let Some(entry) = inside.waiting.pop_front() else { return Ok(!inside.closed) };
        drop(inside);
        writer.write(&entry)?;
        let mut inside = self.lock();
        inside.entries += 1;
        inside.bytes = inside.bytes.saturating_sub(size(&entry));
        drop(inside);
        self.changed.notify_all();
        Ok(true)
    }
}

/// Returns the approximate size of an entry in memory, bytes.
fn size(entry: &Entry) -> usize {
    value_size(&entry.action) + value_size(&entry.reply) + entry.shot.as_ref().map_or(0, Shot::bytes)
}

fn value_size(value: &Value) -> usize {
    VALUE_BYTES
        + match value {
            Value::String(words) => words.len(),
            Value::Array(values) => values.iter().map(value_size).sum(),
            Value::Object(values) => values.iter().map(|(key, value)| key.len() + value_size(value)).sum(),
            _ => 0,
        }
}

fn disk(error: std::io::Error) -> TapeError {
    TapeError::Disk { doing: "written", source: error.into() }
}
