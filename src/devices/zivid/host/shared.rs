//! The state shared between the thread that supervises a worker and the threads that make requests.

use crate::zivid::budget::Restarts;
use crate::zivid::fault::ZividFault;
use crate::zivid::message::{ClipEnd, Identity, Lens, Light, Size, Source, Temperatures};
use crate::zivid::process::ShotDelivery;
use crate::zivid::sensor::ShotPlanes;
use crate::zivid::warmth::{self, TemperatureReading};
use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The configuration of a camera.
#[derive(Debug, Clone)]
pub struct CameraSetup {
    /// Selects the camera.
    pub source: Source,
    /// The serial number of the calibrated camera, if known.
    pub serial: Option<String>,
    /// The size for which the camera was calibrated.
    pub size: Size,
    /// Settings of 3D shots: the text of their YAML file.
    pub scan_yaml: String,
    /// Settings of pictures.
    pub picture_yaml: String,
    /// The limit for restarts of the worker.
    pub restarts: Restarts,
    /// Time limits for the answers.
    pub timeouts: AnswerTimeouts,
}

/// Time limits for the answers of the worker.
#[derive(Debug, Clone, Copy)]
pub struct AnswerTimeouts {
    /// For the worker's first message, before which the worker starts the SDK.
    pub hello: Duration,
    /// For finding and opening a camera; the vendor's own samples allow 100 s.
    pub connect: Duration,
    /// For the first shot, for which the SDK may compile its programs: 100 s in the vendor's samples.
    pub warm_up: Duration,
    /// A 3D shot.
    pub scan: Duration,
    /// For a picture, or the next picture of a clip.
    pub picture: Duration,
    /// Settings and temperatures, which need no exposure.
    pub settings_and_temperatures: Duration,
    /// Interval between searches for an absent camera.
    pub search: Duration,
}

impl Default for AnswerTimeouts {
    fn default() -> Self {
        let s = Duration::from_secs;
        AnswerTimeouts {
            hello: s(30),
            connect: s(100),
            warm_up: s(100),
            scan: s(15),
            picture: s(6),
            settings_and_temperatures: s(10),
            search: s(3),
        }
    }
}

impl AnswerTimeouts {
    /// Returns the time limit from the start of the worker to the first shot.
    pub fn start(&self) -> Duration {
        self.hello + self.connect + 2 * self.settings_and_temperatures + self.warm_up
    }

    /// Returns the time limit for the answer to this request, for each attempt.
    pub fn timeout(&self, ask: CameraRequest) -> Duration {
        match ask {
            CameraRequest::Scan => self.scan,
            // At the end of a clip, the program waits for the picture that is being taken.
            CameraRequest::Picture
            | CameraRequest::BeginClip(_)
            | CameraRequest::NextPicture
            | CameraRequest::EndClip => self.picture,
            CameraRequest::Intrinsics | CameraRequest::Check => self.settings_and_temperatures,
            // The measurement includes an exposure of some duration.
            CameraRequest::Light => self.scan,
        }
    }
}

/// The state of the camera.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraStage {
    /// The worker is being started, since this time.
    Starting(Instant),
    /// The camera delivers.
    Ready(Identity),
    /// The worker is present; the camera is absent, or cannot be used.
    NoCamera(ZividFault),
    /// The worker stays down until a person requests it.
    Down(ZividFault),
}

/// The camera's status, for all clients.
#[derive(Debug)]
pub struct Status {
    /// The camera's state.
    pub stage: CameraStage,
    /// Number of times that a worker was lost.
    pub lost: usize,
    /// The last faults, in order.
    pub faults: VecDeque<ZividFault>,
    /// The worker's process.
    pub worker: Option<u32>,
    /// The lens's temperatures, in order, for the period that is needed to judge whether the camera is warm.
    pub temperatures: VecDeque<TemperatureReading>,
}

/// Interval between temperature readings of a camera without requests.
const TEMPERATURE_INTERVAL: Duration = Duration::from_secs(30);

/// Largest number of stored faults.
const MAX_FAULTS: usize = 1_000;

/// The data that the thread and its users share.
#[derive(Debug)]
pub struct Shared {
    status: Mutex<Status>,
    changed: Condvar,
    /// No more requests come.
    pub is_ending: Arc<AtomicBool>,
}

impl Default for Shared {
    /// Creates the state before the first start.
    fn default() -> Self {
        let stage = CameraStage::Starting(Instant::now());
        let (faults, temperatures) = (VecDeque::new(), VecDeque::new());
        let status = Status { stage, lost: 0, faults, worker: None, temperatures };
        Shared { status: Mutex::new(status), changed: Condvar::new(), is_ending: Arc::default() }
    }
}

impl Shared {
    /// Locks and returns the present status.
    pub fn status(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the camera is no longer being started, at most for this time. Returns its state at that time.
    pub fn wait_started(&self, within: Duration) -> CameraStage {
        let starting = |status: &mut Status| matches!(status.stage, CameraStage::Starting(_));
        let waited = self.changed.wait_timeout_while(self.status(), within, starting);
        waited.unwrap_or_else(PoisonError::into_inner).0.stage.clone()
    }

    pub(super) fn set_stage(&self, stage: CameraStage) {
        self.status().stage = stage;
        self.changed.notify_all();
    }

    /// Records the lens temperature at this time, ns of the monotonic clock.
    pub(super) fn record_temperature(&self, at_ns: u64, lens_c: Option<f64>) {
        let Some(lens_c) = lens_c else { return };
        let (mut status, at_s) = (self.status(), at_ns as f64 * 1e-9);
        status.temperatures.push_back(TemperatureReading { at_s, lens_c });
        while status.temperatures.front().is_some_and(|oldest| at_s - oldest.at_s > warmth::MAX_TEMPERATURE_AGE_S) {
            status.temperatures.pop_front();
        }
    }

    /// Returns whether the last temperature is too old.
    pub(super) fn is_temperature_due(&self, now_ns: u64) -> bool {
        let last_s = self.status().temperatures.back().map_or(f64::NEG_INFINITY, |last| last.at_s);
        now_ns as f64 * 1e-9 - last_s > TEMPERATURE_INTERVAL.as_secs_f64()
    }

    pub(super) fn record_fault(&self, fault: &ZividFault) {
        let mut status = self.status();
        status.faults.push_back(fault.clone());
        if status.faults.len() > MAX_FAULTS {
            status.faults.pop_front();
        }
        match fault.reports_unknown_value() {
            true => tracing::debug!("{fault}"),
            false => tracing::warn!("{fault}"),
        }
    }
}

/// A request to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraRequest {
    /// A 3D shot.
    Scan,
    /// A picture.
    Picture,
    /// Take pictures from now on, at this highest rate, 1/s.
    BeginClip(f64),
    /// The next picture of the clip.
    NextPicture,
    /// The end of the clip.
    EndClip,
    /// The camera's model of its lens, for 3D shots.
    Intrinsics,
    /// Reads the camera's temperatures; a worker that stays down is started again if its budget allows.
    Check,
    /// Measure how the ambient light flickers.
    Light,
}

impl CameraRequest {
    /// Returns the description for messages.
    pub fn describe(self) -> &'static str {
        match self {
            CameraRequest::Scan => "a 3D shot",
            CameraRequest::Picture => "a picture",
            CameraRequest::BeginClip(_) => "the start of a clip",
            CameraRequest::NextPicture => "a picture of a clip",
            CameraRequest::EndClip => "the end of a clip",
            CameraRequest::Intrinsics => "a query of the lens data",
            CameraRequest::Check => "a query of the temperatures",
            CameraRequest::Light => "a query of the ambient light",
        }
    }
}

/// The camera's answer.
#[derive(Debug)]
pub enum CameraAnswer {
    /// A 3D shot.
    Scan(ShotDelivery, ShotPlanes),
    /// A picture.
    Picture(ShotDelivery, Vec<[u8; 3]>),
    /// The request was carried out.
    Done,
    /// A clip has ended.
    Clip(ClipEnd),
    /// The lens.
    Lens(Lens),
    /// The temperatures.
    State(Temperatures),
    /// The light.
    Light(Light),
}

/// A request, and the receiver of its answer.
#[derive(Debug)]
pub struct QueuedRequest {
    /// The request.
    pub ask: CameraRequest,
    /// The caller no longer waits.
    pub is_abandoned: Arc<AtomicBool>,
    /// The channel for the answer.
    pub answer: Sender<Result<CameraAnswer, ZividFault>>,
}
