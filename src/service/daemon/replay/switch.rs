//! The recording switch of all recorded ports: which cycle is recorded, and in which file.
//!
//! The command that runs one cycle records from its start. The service runs for months, so it records single cycles:
//! from the moment at which the loop receives the request to start a cycle until the loop is idle again. The recording
//! begins with the data that the loop keeps from before the cycle. All slow work (the file, its beginning, each entry)
//! is done by the recording's own thread.

use super::queue::{FreeSpace, QueueBounds, Recorder, Recording};
use crate::setup::{Calibrations, RecordingPlan, RecordingResult, clock::now_unix_ns, free_mb, recording_file};
use panelprep_base::geometry::KukaPose;
use panelprep_base::supervision::{SupervisedThread, Supervisor, supervise};
use panelprep_cell::cycle::{Request, State};
use panelprep_cell::record::CycleId;
use panelprep_store::tape::{Entry, FramePose, Lens, LoopMemoryStart, RecordingStart, TapeError, Topic, Writer};
use serde_json::{Value, json};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Maximum time between two heartbeats of the writing thread; compressing a picture takes less.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(20);

/// The switch that decides whether the traffic of the ports is recorded now. All clones share the same switch.
#[derive(Debug, Clone)]
pub struct RecordingSwitch(Arc<Mutex<Inside>>);

#[derive(Debug)]
struct Inside {
    store: PathBuf,
    lock_step: bool,
    /// The state in which the loop last requested the next request.
    state: State,
    /// For a cycle that is being started: the plan of its recording, the request to the state table, and the state at
    /// that time.
    wanted: Option<(RecordingPlan, Request, State)>,
    recorder: Option<Recorder>,
    /// Whether the cycle has ended; answers that are still expected belong to it.
    is_over: bool,
    /// The recording that has ended, until it is taken by [`RecordingSwitch::finished_recording`].
    recording: Option<Recording>,
    /// File and recorder of the last recording, for its status.
    last: Option<(String, Recorder)>,
    /// The supervisor of the writing threads.
    supervisor: Supervisor,
}

impl RecordingSwitch {
    /// Creates a switch that is off; recordings without a given file are stored in the folder of this store.
    pub fn new(store: &Path, lock_step: bool) -> Self {
        RecordingSwitch(Arc::new(Mutex::new(Inside {
            store: store.to_owned(),
            lock_step,
            state: State::INITIAL,
            wanted: None,
            recorder: None,
            is_over: false,
            recording: None,
            last: None,
            supervisor: Supervisor::default(),
        })))
    }

    /// Registers the writing threads at this supervisor.
    pub fn watched_by(&self, supervisor: &Supervisor) {
        self.lock().supervisor = supervisor.clone();
    }

    /// Records in this new file from now on, until [`RecordingSwitch::finish`].
    ///
    /// # Errors
    /// If the file already exists, or the disk cannot be written.
    pub fn begin_recording(&self, file: &Path, to: RecordingPlan, state: State) -> io::Result<()> {
        let out = OpenOptions::new().write(true).create_new(true).open(file)?;
        self.lock().start((file, to), state, LoopMemoryStart::Boot, move || Ok(out))
    }

    /// Ends the recording and waits until it is written; `None` if no recording was in progress.
    pub fn finish(&self) -> Option<RecordingResult> {
        let recording = {
            let mut inside = self.lock();
            inside.recorder = None;
            inside.recording.take()?
        };
        Some(recording.finish())
    }

    /// Returns the status of the last recording; `None` if there was no recording.
    pub fn status(&self) -> Option<RecordingResult> {
        let inside = self.lock();
        inside.last.as_ref().map(|(file, recorder)| recorder.status(file))
    }

    /// Returns the recording of the ended cycle, if it was not returned yet.
    pub fn finished_recording(&self) -> Option<Recording> {
        let mut inside = self.lock();
        if inside.recorder.is_some() { None } else { inside.recording.take() }
    }

    pub(super) fn recorder(&self) -> Option<Recorder> {
        self.lock().recorder.clone()
    }

    /// Handles the loop's receipt of a request to start a cycle.
    pub(super) fn on_order(&self, plan: Option<RecordingPlan>, request: Request) {
        let mut inside = self.lock();
        let state = inside.state;
        if inside.recorder.is_none() {
            inside.wanted = plan.map(|plan| (plan, request, state));
        }
    }

    /// Handles the start of the requested cycle.
    pub(super) fn on_cycle_start(&self, cycle: CycleId, before: LoopMemoryStart) {
        let mut inside = self.lock();
        inside.last = None;
        let Some((to, request, state)) = inside.wanted.take() else { return };
        let file = to.file.clone().unwrap_or_else(|| recording_file(&inside.store, cycle));
        let made = file.clone();
        let open = move || {
            made.parent().map_or(Ok(()), fs::create_dir_all)?;
            OpenOptions::new().write(true).create_new(true).open(&made)
        };
        match inside.start((&file, to), state, before, open) {
            Ok(()) => inside.on_received_request(json!({ "for": request })),
            Err(error) => tracing::warn!("cycle {cycle} is not recorded for replay: {error}"),
        }
    }

    /// Handles the end of the cycle, as far as the loop knows.
    pub(super) fn on_cycle_end(&self) {
        let mut inside = self.lock();
        inside.is_over = inside.recorder.is_some();
    }

    /// Handles the loop's question for the next request. If the cycle has ended, all its data have arrived by now, and
    /// the recording ends with the request to leave.
    pub(super) fn on_request_poll(&self, state: &State) {
        let mut inside = self.lock();
        inside.state = *state;
        if std::mem::take(&mut inside.is_over) {
            inside.on_received_request(json!("leave"));
            if let Some(recorder) = inside.recorder.take() {
                recorder.close();
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inside {
    fn start(
        &mut self,
        (file, to): (&Path, RecordingPlan),
        state: State,
        begin: LoopMemoryStart,
        open: impl FnOnce() -> io::Result<File> + Send + 'static,
    ) -> io::Result<()> {
        let RecordingPlan { files, calibrations, .. } = to;
        let start = RecordingStart {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            unix_ns: now_unix_ns(),
            state,
            lock_step: self.lock_step,
            begin,
            hand_eye_mm: calibrations.hand_eye_mm,
            robot_mm: calibrations.robot_mm,
        };
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).map(Path::to_owned);
        let (sign, watched) = supervise("recording", HEARTBEAT_TIMEOUT);
        let sign = Arc::new(sign);
        let of_disk = sign.clone();
        let begun = move || {
            let made = open().and_then(|out| {
                // The folder is also flushed to the disk, because it contains the name of the new file.
                folder.map_or(Ok(()), |folder| File::open(folder)?.sync_all())?;
                Ok(out)
            });
            let out = made.map_err(|error| TapeError::Disk { doing: "made", source: error.into() })?;
            let (mounted, lenses) = (mounting_poses(&calibrations), camera_lenses(&calibrations));
            Writer::begin_recording(BufWriter::new(DurableFile(out, of_disk)), &start, &files, &mounted, &lenses)
        };
        let name = file.display().to_string();
        let bounds = (QueueBounds::new(self.lock_step), Some(sign));
        let recording = Recording::start(name.clone(), begun, bounds, free_space_reader(file))?;
        self.supervisor.add_thread(watched);
        (self.recorder, self.is_over) = (Some(recording.recorder()), false);
        self.last = Some((name, recording.recorder()));
        self.recording = Some(recording);
        Ok(())
    }

    fn on_received_request(&self, heard: Value) {
        if let Some(recorder) = &self.recorder {
            recorder.record_entry(Entry {
                topic: Topic::Request,
                at_ns: 0,
                action: Value::Null,
                reply: heard,
                shot: None,
            });
        }
    }
}

/// A file whose data are flushed to the disk, because after a power failure data that are only in memory would be lost.
/// While the disk works, no heartbeat of the thread is expected.
struct DurableFile(File, Arc<SupervisedThread>);

impl DurableFile {
    fn without_heartbeat<T>(&mut self, disk: impl FnOnce(&mut File) -> io::Result<T>) -> io::Result<T> {
        self.1.report_resting();
        let done = disk(&mut self.0);
        self.1.report_working();
        done
    }
}

impl Write for DurableFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.without_heartbeat(|file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.without_heartbeat(|file| file.sync_data())
    }
}

/// Returns the poses of the cameras and the tool, for viewers of the recording.
fn mounting_poses(values: &Calibrations) -> [FramePose; 3] {
    let mounted = |parent, child, pose| FramePose { parent, child, pose };
    [
        mounted("base", "scanner", KukaPose::from_rigid(&values.base_from_camera)),
        mounted("flange", "flange_camera", KukaPose::from_rigid(&values.flange_from_camera)),
        mounted("flange", "tool", KukaPose::from_rigid(&values.flange_from_tool)),
    ]
}

/// Returns the lens parameters of the cameras, for the recording.
fn camera_lenses(values: &Calibrations) -> [Lens; 2] {
    let lens = |topic, camera| Lens { topic, camera };
    [lens(Topic::ScannerLens, values.scanner), lens(Topic::FlangeLens, values.flange_camera)]
}

/// Returns a function that measures the free space on the disk of this file, MB.
fn free_space_reader(file: &Path) -> FreeSpace {
    let file = file.to_owned();
    Box::new(move || free_mb(&file))
}
