//! The Zivid camera as the fixed camera of the cell.

use super::fault::ZividFault;
use super::host::{
    AnswerTimeouts, CameraAnswer, CameraRequest, CameraSetup, CameraStage, Host, MAX_ATTEMPTS, QueuedRequest,
    Shared,
};
use super::message::{ClipEnd, Lens, Light, ShotInfo, Size, Temperatures, now_ns};
use super::process::{ShotDelivery, WorkerLauncher};
use super::warmth::{WarmUpState, judge_warm_up};
use crate::cameras::{CameraError, Conditions, Picture, Scanner, Shot};
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};
use panelprep_cell::cell::ZividSettings;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A 3D scan with its metadata.
#[derive(Debug, Clone)]
pub struct ZividShot {
    /// Points and colours.
    pub cloud: OrganizedCloud<Camera>,
    /// The signal to noise ratio of each point.
    pub snr: Vec<f32>,
    /// The metadata of the scan.
    pub metadata: ShotInfo,
    /// Time from the availability of the data in the worker until the scan was received and checked here, ms.
    pub crossed_ms: f64,
}

/// A colour picture with its metadata.
#[derive(Debug, Clone)]
pub struct ZividPicture {
    /// The picture.
    pub picture: ColorPicture,
    /// The metadata of the picture; in a clip also the number of pictures that were dropped so far.
    pub metadata: ShotInfo,
}

/// A Zivid camera, which is controlled through its worker process.
pub struct ZividScanner {
    orders: Sender<QueuedRequest>,
    shared: Arc<Shared>,
    timeouts: AnswerTimeouts,
    size: Size,
    /// The exposure times of 3D scans and of pictures, from their settings, µs.
    exposures_us: [Option<f64>; 2],
    /// The conditions of the last scan or picture.
    conditions: Conditions,
    thread: Option<JoinHandle<()>>,
}

/// A read-only view of the status of a camera that another thread uses.
#[derive(Debug, Clone)]
pub struct CameraMonitor(Arc<Shared>);

impl CameraMonitor {
    /// Returns the recorded faults.
    pub fn faults(&self) -> Vec<ZividFault> {
        self.0.status().faults.iter().cloned().collect()
    }

    /// Returns how many times a worker was lost.
    pub fn lost_workers(&self) -> usize {
        self.0.status().lost
    }

    /// The worker's process.
    pub fn worker(&self) -> Option<u32> {
        self.0.status().worker
    }
}

/// Maximum waiting time of a check, for example for a worker that is starting.
const CHECK_TIMEOUT: Duration = Duration::from_secs(10);
/// Additional time limit for ending a worker that does not respond.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which a waiting caller checks the state of the camera.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

impl ZividScanner {
    /// Starts the worker in the background. The camera is ready when it is warmed up.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn start(setup: CameraSetup, launch: WorkerLauncher) -> std::io::Result<Self> {
        let (orders, taken) = mpsc::channel();
        let shared = Arc::new(Shared::default());
        let (patience, size) = (setup.timeouts, setup.size);
        let exposures_us =
            [&setup.scan_yaml, &setup.picture_yaml].map(|yaml| ZividSettings::read("", yaml).ok()?.exposure_us());
        let host = Host::new(setup, launch, shared.clone());
        let thread = thread::Builder::new().name("zivid".to_owned()).spawn(move || host.run(&taken))?;
        let (conditions, thread) = (Conditions::default(), Some(thread));
        Ok(ZividScanner { orders, shared, timeouts: patience, size, exposures_us, conditions, thread })
    }

    /// Waits until the camera is ready, but not longer than this time.
    ///
    /// # Errors
    /// If the camera is not ready within this time; the error is the reason.
    pub fn wait_ready(&self, within: Duration) -> Result<(), ZividFault> {
        match self.shared.wait_started(within) {
            CameraStage::Ready(_) => Ok(()),
            CameraStage::NoCamera(fault) | CameraStage::Down(fault) => Err(fault),
            CameraStage::Starting(since) => Err(self.starting_fault(since)),
        }
    }

    fn starting_fault(&self, since: Instant) -> ZividFault {
        ZividFault::Starting { since: since.elapsed(), most: self.timeouts.start() }
    }

    /// Returns the recorded faults, the number of lost workers, and the process ID of the worker.
    pub fn history(&self) -> (Vec<ZividFault>, usize, Option<u32>) {
        let status = self.shared.status();
        (status.faults.iter().cloned().collect(), status.lost, status.worker)
    }

    /// Returns a monitor by which another thread can read the camera's state at any time.
    pub fn monitor(&self) -> CameraMonitor {
        CameraMonitor(self.shared.clone())
    }

    /// Returns whether the camera has reached its stable temperature, according to the temperatures that it has
    /// reported.
    pub fn temperature_state(&self) -> WarmUpState {
        judge_warm_up(self.shared.status().temperatures.make_contiguous(), now_ns() as f64 * 1e-9)
    }

    fn update_conditions(&mut self, taken: &ShotInfo, exposure_us: Option<f64>) {
        let throttled_ms = Some(taken.throttled_ms);
        self.conditions = Conditions { exposure_us, camera_c: taken.lens_c, throttled_ms };
    }

    fn send_request(&self, ask: CameraRequest) -> Result<CameraAnswer, ZividFault> {
        if ask != CameraRequest::Check {
            // A request must not wait for the start of a worker.
            self.wait_ready(Duration::ZERO)?;
        }
        let is_given_up = Arc::new(AtomicBool::new(false));
        let (answer, answered) = mpsc::channel();
        let order = QueuedRequest { ask, is_abandoned: is_given_up.clone(), answer };
        let gone = || ZividFault::NoWorker("the worker's control thread has ended: restart the service".to_owned());
        self.orders.send(order).map_err(|_| gone())?;
        let begun = Instant::now();
        let wait_limit = if ask == CameraRequest::Check {
            CHECK_TIMEOUT
        } else {
            MAX_ATTEMPTS * self.timeouts.timeout(ask) + SHUTDOWN_TIMEOUT
        };
        loop {
            match answered.recv_timeout(POLL_INTERVAL) {
                Ok(found) => return found,
                Err(RecvTimeoutError::Disconnected) => return Err(gone()),
                // The camera was lost before this request and is starting again, which may take minutes.
                Err(RecvTimeoutError::Timeout) if ask != CameraRequest::Check => {
                    if let CameraStage::Starting(since) = self.shared.status().stage {
                        is_given_up.store(true, Ordering::Relaxed);
                        // If this request caused the loss of the worker, its reply arrives soon.
                        return answered.recv_timeout(POLL_INTERVAL).unwrap_or(Err(self.starting_fault(since)));
                    }
                }
                Err(RecvTimeoutError::Timeout) if begun.elapsed() > wait_limit => {
                    is_given_up.store(true, Ordering::Relaxed);
                    return Err(self.no_answer_fault(ask, begun.elapsed()));
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Returns the reason, from the state of the camera, why there is no reply yet.
    fn no_answer_fault(&self, ask: CameraRequest, waited: Duration) -> ZividFault {
        match self.shared.status().stage.clone() {
            CameraStage::NoCamera(fault) | CameraStage::Down(fault) => fault,
            CameraStage::Starting(since) => self.starting_fault(since),
            CameraStage::Ready(_) => ZividFault::Stuck { during: ask.describe(), waited },
        }
    }

    /// Captures a 3D scan with colours.
    ///
    /// # Errors
    /// If the camera delivers no acceptable scan.
    pub fn take_scan(&mut self) -> Result<ZividShot, ZividFault> {
        match self.send_request(CameraRequest::Scan)? {
            CameraAnswer::Scan(ShotDelivery { metadata: taken, arrived_ns: came_ns, .. }, planes) => {
                let Size { width, height } = taken.size;
                self.update_conditions(&taken, self.exposures_us[0]);
                let crossed_ms = came_ns.saturating_sub(taken.ready_ns) as f64 * 1e-6;
                let cloud = OrganizedCloud::new(width, height, planes.points_mm, planes.colors)
                    .map_err(|error| unexpected_answer_fault(&error))?;
                Ok(ZividShot { cloud, snr: planes.snr, metadata: taken, crossed_ms })
            }
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }

    /// Captures one colour picture.
    ///
    /// # Errors
    /// If the camera delivers no acceptable picture.
    pub fn take_picture(&mut self) -> Result<ZividPicture, ZividFault> {
        self.request_picture(CameraRequest::Picture)
    }

    /// Starts a clip: pictures are captured continuously, at most at this rate per second. Any other capture ends the
    /// clip.
    ///
    /// # Errors
    /// If the camera cannot start the clip.
    pub fn begin_clip(&mut self, pictures_per_second: f64) -> Result<(), ZividFault> {
        self.send_request(CameraRequest::BeginClip(pictures_per_second)).map(drop)
    }

    /// Returns the next picture of the clip. Pictures that are not fetched in time are dropped and counted, the oldest
    /// first.
    ///
    /// # Errors
    /// If the camera delivers no acceptable picture.
    pub fn next_clip_picture(&mut self) -> Result<ZividPicture, ZividFault> {
        self.request_picture(CameraRequest::NextPicture)
    }

    /// Ends the clip and returns its statistics.
    ///
    /// # Errors
    /// If the camera does not confirm the end of the clip.
    pub fn end_clip(&mut self) -> Result<ClipEnd, ZividFault> {
        match self.send_request(CameraRequest::EndClip)? {
            CameraAnswer::Clip(end) => Ok(end),
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }

    /// Returns the camera's own lens model for the settings of 3D scans.
    ///
    /// # Errors
    /// If the camera does not report the lens model.
    pub fn intrinsics(&mut self) -> Result<Lens, ZividFault> {
        match self.send_request(CameraRequest::Intrinsics)? {
            CameraAnswer::Lens(lens) => Ok(lens),
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }

    /// Returns the camera's temperatures. If the camera is starting, the function waits for a limited time. If the
    /// worker is down, it is restarted if the budget permits, because a person's reset calls this function.
    ///
    /// # Errors
    /// If the camera does not report its temperatures.
    pub fn temperatures(&mut self) -> Result<Temperatures, ZividFault> {
        if let CameraStage::Starting(since) = self.shared.wait_started(CHECK_TIMEOUT) {
            return Err(self.starting_fault(since));
        }
        match self.send_request(CameraRequest::Check)? {
            CameraAnswer::State(temperatures) => Ok(temperatures),
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }

    /// Measures the flicker of the ambient light.
    ///
    /// # Errors
    /// If the camera does not measure the ambient light.
    pub fn measure_ambient_light(&mut self) -> Result<Light, ZividFault> {
        match self.send_request(CameraRequest::Light)? {
            CameraAnswer::Light(light) => Ok(light),
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }

    fn request_picture(&mut self, ask: CameraRequest) -> Result<ZividPicture, ZividFault> {
        match self.send_request(ask)? {
            CameraAnswer::Picture(ShotDelivery { metadata: taken, .. }, rgb) => {
                self.update_conditions(&taken, self.exposures_us[1]);
                let Size { width, height } = self.size;
                Ok(ZividPicture { picture: ColorPicture { width, height, rgb }, metadata: taken })
            }
            _ => Err(unexpected_answer_fault(&"something else came")),
        }
    }
}

fn unexpected_answer_fault(what: &dyn std::fmt::Display) -> ZividFault {
    ZividFault::OutOfOrder { during: "the request", message: what.to_string() }
}

impl Drop for ZividScanner {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = thread.join();
        }
    }
}

/// Returns the time of a scan or picture: the time at which the camera received the request, s of the monotonic clock.
fn time_s(taken: &ShotInfo) -> f64 {
    taken.begun_ns as f64 * 1e-9
}

impl Scanner for ZividScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        let shot = self.take_scan()?;
        Ok(Shot { time_s: time_s(&shot.metadata), cloud: shot.cloud })
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        let photo = self.take_picture()?;
        Ok(Picture { time_s: time_s(&photo.metadata), picture: photo.picture })
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        ZividScanner::begin_clip(self, pictures_per_second)?;
        // If no picture is dropped, the exposure of the first one has begun before this time.
        Ok(now_ns() as f64 * 1e-9)
    }

    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        let photo = ZividScanner::next_clip_picture(self)?;
        Ok(Some(Picture { time_s: time_s(&photo.metadata), picture: photo.picture }))
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        Ok(ZividScanner::end_clip(self)?.dropped)
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        let found = self.temperatures()?;
        tracing::info!(?found, "the 3D camera passed its check");
        match self.temperature_state() {
            WarmUpState::Warm { .. } => {}
            doubt => tracing::warn!("{doubt}"),
        }
        Ok(())
    }

    fn wait_warmed_up(&mut self) {
        self.shared.wait_started(self.timeouts.start());
    }

    fn conditions(&self) -> Conditions {
        self.conditions
    }
}
