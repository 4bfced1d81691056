//! The state that the supervisor of a worker shares with the threads that make requests.

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

/// The configuration of a Zivid camera.
#[derive(Debug, Clone)]
pub struct CameraSetup {
    /// Selects the camera.
    pub source: Source,
    /// The serial number of the calibrated camera, if known.
    pub serial: Option<String>,
    /// The picture size for which the camera was calibrated.
    pub size: Size,
    /// The settings for 3D scans, as the text of their YAML file.
    pub scan_yaml: String,
    /// Settings of pictures.
    pub picture_yaml: String,
    /// The restart budget of the worker.
    pub restarts: Restarts,
    /// The time limits for the worker's replies.
    pub timeouts: AnswerTimeouts,
}

/// Time limits for the replies of the worker.
#[derive(Debug, Clone, Copy)]
pub struct AnswerTimeouts {
    /// Time limit for the worker's first message; before this message the worker starts the SDK.
    pub hello: Duration,
    /// Time limit for finding and opening a camera; the vendor's own samples use 100 s.
    pub connect: Duration,
    /// Time limit for the first scan, for which the SDK may compile its GPU programs; the vendor's samples use 100 s.
    pub warm_up: Duration,
    /// A 3D shot.
    pub scan: Duration,
    /// Time limit for a picture, or for the next picture of a clip.
    pub picture: Duration,
    /// Time limit for settings and temperatures, which need no exposure.
    pub settings_and_temperatures: Duration,
    /// Interval between two searches for an absent camera.
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
    /// Returns the total time limit from the start of the worker to the first scan.
    pub fn start(&self) -> Duration {
        self.hello + self.connect + 2 * self.settings_and_temperatures + self.warm_up
    }

    /// Returns the time limit for the reply to this request, for each attempt.
    pub fn timeout(&self, ask: CameraRequest) -> Duration {
        match ask {
            CameraRequest::Scan => self.scan,
            // The end of a clip waits for the picture that is being captured.
            CameraRequest::Picture
            | CameraRequest::BeginClip(_)
            | CameraRequest::NextPicture
            | CameraRequest::EndClip => self.picture,
            CameraRequest::Intrinsics | CameraRequest::Check => self.settings_and_temperatures,
            // The measurement of the ambient light includes an exposure.
            CameraRequest::Light => self.scan,
        }
    }
}

/// The state of the camera.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraStage {
    /// The worker is starting; contains the time of the start.
    Starting(Instant),
    /// The camera delivers.
    Ready(Identity),
    /// The worker runs, but the camera is absent or cannot be used because of this fault.
    NoCamera(ZividFault),
    /// The worker is down until a person requests a restart.
    Down(ZividFault),
}

/// The status of the camera, for all threads.
#[derive(Debug)]
pub struct Status {
    /// The camera's state.
    pub stage: CameraStage,
    /// Number of times a worker was lost.
    pub lost: usize,
    /// The last faults, oldest first.
    pub faults: VecDeque<ZividFault>,
    /// The worker's process.
    pub worker: Option<u32>,
    /// The temperatures of the lens, oldest first, for the period that is needed to judge whether the camera is warm.
    pub temperatures: VecDeque<TemperatureReading>,
}

/// Interval at which the temperature is read while there are no requests.
const TEMPERATURE_INTERVAL: Duration = Duration::from_secs(30);

/// Maximum number of stored faults.
const MAX_FAULTS: usize = 1_000;

/// The data that the supervisor's thread and its callers share.
#[derive(Debug)]
pub struct Shared {
    status: Mutex<Status>,
    changed: Condvar,
    /// Whether the supervisor is ending, so that no more requests are processed.
    pub is_ending: Arc<AtomicBool>,
}

impl Default for Shared {
    /// Creates the state before the worker is started.
    fn default() -> Self {
        let stage = CameraStage::Starting(Instant::now());
        let (faults, temperatures) = (VecDeque::new(), VecDeque::new());
        let status = Status { stage, lost: 0, faults, worker: None, temperatures };
        Shared { status: Mutex::new(status), changed: Condvar::new(), is_ending: Arc::default() }
    }
}

impl Shared {
    /// Locks and returns the current status.
    pub fn status(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the start of the worker and the camera has ended, but not longer than this time. Returns the state.
    pub fn wait_started(&self, within: Duration) -> CameraStage {
        let starting = |status: &mut Status| matches!(status.stage, CameraStage::Starting(_));
        let waited = self.changed.wait_timeout_while(self.status(), within, starting);
        waited.unwrap_or_else(PoisonError::into_inner).0.stage.clone()
    }

    pub(super) fn set_stage(&self, stage: CameraStage) {
        self.status().stage = stage;
        self.changed.notify_all();
    }

    /// Records the temperature of the lens at this time, ns of the monotonic clock.
    pub(super) fn record_temperature(&self, at_ns: u64, lens_c: Option<f64>) {
        let Some(lens_c) = lens_c else { return };
        let (mut status, at_s) = (self.status(), at_ns as f64 * 1e-9);
        status.temperatures.push_back(TemperatureReading { at_s, lens_c });
        while status.temperatures.front().is_some_and(|oldest| at_s - oldest.at_s > warmth::MAX_TEMPERATURE_AGE_S) {
            status.temperatures.pop_front();
        }
    }

    /// Returns whether the temperature must be read again.
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
    /// Starts a clip with at most this number of pictures per second.
    BeginClip(f64),
    /// Requests the next picture of the clip.
    NextPicture,
    /// Ends the clip.
    EndClip,
    /// Requests the camera's own lens model for 3D scans.
    Intrinsics,
    /// Reads the camera's temperatures; if the worker is down, it is restarted if the budget permits.
    Check,
    /// Measures the flicker of the ambient light.
    Light,
}

impl CameraRequest {
    /// Returns a description of the request, for messages.
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

/// A request, with the channel for its reply.
#[derive(Debug)]
pub struct QueuedRequest {
    /// The request.
    pub ask: CameraRequest,
    /// Whether the caller no longer waits for the reply.
    pub is_abandoned: Arc<AtomicBool>,
    /// The channel to which the reply is sent.
    pub answer: Sender<Result<CameraAnswer, ZividFault>>,
}
