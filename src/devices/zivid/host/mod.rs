//! Supervises a worker process: starts it, opens the camera, warms it up, checks it, sends it requests, and restarts it
//! within its restart budget.
//!
//! ```text
//! start ─ hello ─ connect ─ settings ─ warm-up ─ ready ─┬─ asked … ─┐
//!   ↑                ↑________________ camera gone ______│           │
//!   └─── restart, within the budget ──── worker lost ────┴───────────┘
//! ```
//! The supervisor has its own thread and replies through a channel, so that no caller waits longer than its time limit.
//! A worker is treated as lost if it ends, stalls, or sends data that cannot be read; then it is killed, because its
//! further data could not be trusted. If the camera is absent, the same worker searches for it repeatedly, and the
//! absence is reported once. Each fault is recorded as a text; no fault is corrected silently. While there are no
//! requests, the camera's temperature is read at intervals, so that [`warmth`](super::warmth) can be judged.
//!
//! - this file: requests to a camera that is ready, and the checks of its replies · `shared`: configuration, state and
//!   possible requests · `opening`: start and restart of the worker

mod opening;
mod shared;

use super::accept::{self, ExpectedShot};
use super::budget::{RestartBudget, RestartDecision};
use super::fault::ZividFault;
use super::message::{Identity, Refusal, Reply, Request, SettingsHash, Source, Trouble, now_ns};
use super::process::{Answer, Link, ShotDelivery, WorkerLauncher, WorkerPeer};
use super::wire::WireError;
use super::worker::settings_hash;
pub use shared::{
    AnswerTimeouts, CameraAnswer, CameraRequest, CameraSetup, CameraStage, QueuedRequest, Shared, Status,
};
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Maximum number of attempts for a scan or picture that the camera did not deliver: the first one and two repetitions.
pub(super) const MAX_ATTEMPTS: u32 = 3;

/// Interval of the checks while there is no request.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Time limit in which a worker ends by itself after it has closed its connection.
const EXIT_TIMEOUT: Duration = Duration::from_millis(500);

/// Time limit in which a released worker ends; it closes the camera first, so that another program can open it.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(3);

/// Maximum interval between two searches for a camera, if a person must correct something first.
const MAX_SEARCH_INTERVAL: Duration = Duration::from_secs(60);

struct RunningWorker {
    link: Link,
    peer: Box<dyn WorkerPeer>,
}

/// The hash of the settings, and the checksum of the last scan or picture with these settings.
struct LastShot {
    hash: SettingsHash,
    last_sum: Option<u32>,
}

/// The reason why a request to the worker failed.
enum RequestFailure {
    /// The worker is lost: the connection failed, or the data cannot be read.
    Lost(WireError),
    /// The worker refused the request and states the reason.
    Refused(Refusal),
}

impl From<WireError> for RequestFailure {
    fn from(error: WireError) -> Self {
        RequestFailure::Lost(error)
    }
}

/// The reason why a worker process is not available any more.
enum WorkerLoss {
    /// The worker process has ended.
    Ended(String),
    /// The worker has closed its end of the socket.
    HungUp,
    /// The worker did not reply within this time.
    Stalled(Duration),
    /// The data of the worker cannot be read.
    Damaged(String),
}

impl WorkerLoss {
    fn from_wire_error(error: WireError, waited: Duration) -> Self {
        match error {
            WireError::Ended | WireError::Cut { .. } => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::BrokenPipe => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::ConnectionReset => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::TimedOut => WorkerLoss::Stalled(waited),
            WireError::Stalled { .. } => WorkerLoss::Stalled(waited),
            other => WorkerLoss::Damaged(other.to_string()),
        }
    }
}

fn answer_name(answer: &Answer) -> String {
    match answer {
        Answer::Words(_) => "the worker responded with another message".to_owned(),
        Answer::Scan(..) => "the worker responded with a 3D shot".to_owned(),
        Answer::Picture(..) => "the worker responded with a picture".to_owned(),
    }
}

/// The supervisor of a worker: the state of its thread.
pub struct Host {
    setup: CameraSetup,
    launch: WorkerLauncher,
    shared: Arc<Shared>,
    budget: RestartBudget,
    began: Instant,
    worker: Option<RunningWorker>,
    camera: Option<Identity>,
    scan: LastShot,
    picture: LastShot,
    last_number: u64,
    clip_from_ns: u64,
    /// Whether a clip is being recorded.
    takes_clip: bool,
    /// The time of the next search for an absent camera.
    search: Instant,
    /// The delay before the last search.
    search_pause: Duration,
}

impl Host {
    /// Creates the supervisor; the worker is not started yet.
    pub fn new(setup: CameraSetup, launch: WorkerLauncher, shared: Arc<Shared>) -> Self {
        let taking = |yaml: &str| LastShot { hash: settings_hash(yaml), last_sum: None };
        let now = Instant::now();
        Host {
            scan: taking(&setup.scan_yaml),
            picture: taking(&setup.picture_yaml),
            budget: RestartBudget::new(setup.restarts),
            setup,
            launch,
            shared,
            began: now,
            worker: None,
            camera: None,
            last_number: 0,
            clip_from_ns: 0,
            takes_clip: false,
            search: now,
            search_pause: Duration::ZERO,
        }
    }

    /// Processes requests until all senders of requests are dropped.
    pub fn run(mut self, orders: &Receiver<QueuedRequest>) {
        loop {
            self.start_and_open_if_due();
            match orders.recv_timeout(POLL_INTERVAL) {
                Ok(order) if order.is_abandoned.load(Ordering::Relaxed) => {}
                // Sending the reply fails if the caller no longer waits for it, which has no effect.
                Ok(order) => drop(order.answer.send(self.perform(order.ask))),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.end_session(),
            }
            if self.shared.is_ending.load(Ordering::Relaxed) {
                return self.end_session();
            }
        }
    }

    fn end_session(&mut self) {
        if let Some(RunningWorker { link, mut peer }) = self.worker.take() {
            drop(link); // hangs up
            let _ = peer.wait_ended(RELEASE_TIMEOUT);
        }
    }

    /// Starts the worker and opens the camera if this is due and possible.
    fn start_and_open_if_due(&mut self) {
        if matches!(self.shared.status().stage, CameraStage::Down(_)) {
            return;
        }
        if let Some(how) = self.worker.as_mut().and_then(|worker| worker.peer.wait_ended(Duration::ZERO)) {
            self.on_worker_lost("its rest", WorkerLoss::Ended(how));
        } else if self.worker.is_none() {
            self.start();
        } else if self.camera.is_none() && Instant::now() >= self.search {
            self.open();
        } else if self.camera.is_some() && !self.takes_clip && self.shared.is_temperature_due(now_ns()) {
            // The temperature is read only to be recorded; a fault of this request is reported like any other.
            drop(self.request_from_ready(CameraRequest::Check));
        }
    }

    fn perform(&mut self, ask: CameraRequest) -> Result<CameraAnswer, ZividFault> {
        let stage = self.shared.status().stage.clone();
        match (stage, ask) {
            (CameraStage::Ready(_), _) => self.request_from_ready(ask),
            (CameraStage::Starting(since), _) => {
                Err(ZividFault::Starting { since: since.elapsed(), most: self.setup.timeouts.start() })
            }
            (CameraStage::NoCamera(_), CameraRequest::Check) => {
                self.open();
                self.open_on_request()
            }
            (CameraStage::NoCamera(fault), _) => Err(fault),
            (CameraStage::Down(fault), CameraRequest::Check) => self.restart_on_request(fault),
            (CameraStage::Down(fault), _) => Err(self.as_of_now(fault)),
        }
    }

    /// Returns the fault with the current remaining waiting time.
    fn as_of_now(&self, fault: ZividFault) -> ZividFault {
        match fault {
            ZividFault::Down { ended, allowed, within, last, .. } => {
                let wait = self.budget.wait(self.began.elapsed());
                ZividFault::Down { ended, allowed, within, last, wait }
            }
            other => other,
        }
    }

    /// Processes a person's request to restart a worker that is down.
    fn restart_on_request(&mut self, fault: ZividFault) -> Result<CameraAnswer, ZividFault> {
        // A cause other than the budget, such as a missing library, may have been removed, so a start is tried.
        let by_budget = matches!(fault, ZividFault::Down { .. });
        if by_budget && self.budget.on_person_request(self.began.elapsed()) == RestartDecision::StayDown {
            return Err(self.as_of_now(fault));
        }
        self.start();
        self.open_on_request()
    }

    /// Processes a person's request for the camera: tries to open it and returns the result.
    fn open_on_request(&mut self) -> Result<CameraAnswer, ZividFault> {
        let stage = self.shared.status().stage.clone();
        match stage {
            CameraStage::Ready(_) => self.request_from_ready(CameraRequest::Check),
            CameraStage::Starting(since) => {
                Err(ZividFault::Starting { since: since.elapsed(), most: self.setup.timeouts.start() })
            }
            CameraStage::NoCamera(fault) | CameraStage::Down(fault) => Err(fault),
        }
    }
}

impl Host {
    fn send_request(&mut self, request: &Request, within: Duration) -> Result<Answer, RequestFailure> {
        let worker = self.worker.as_mut().ok_or(WireError::Ended)?;
        match worker.link.send_and_receive(request, within)? {
            Answer::Words(Reply::Refused(refusal)) => Err(RequestFailure::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    /// Sends a request to a camera that is ready.
    fn request_from_ready(&mut self, ask: CameraRequest) -> Result<CameraAnswer, ZividFault> {
        let (scan, picture) = (self.scan.hash.clone(), self.picture.hash.clone());
        let within = self.setup.timeouts.timeout(ask);
        let request = match ask {
            CameraRequest::Scan => Request::Scan { settings: scan },
            CameraRequest::Picture => Request::Picture { settings: picture },
            CameraRequest::BeginClip(pictures_per_second) => {
                self.clip_from_ns = now_ns();
                Request::BeginClip { settings: picture, pictures_per_second }
            }
            CameraRequest::NextPicture => Request::NextPicture,
            CameraRequest::EndClip => Request::EndClip,
            CameraRequest::Intrinsics => Request::Intrinsics { settings: scan },
            CameraRequest::Check => Request::State,
            CameraRequest::Light => Request::Light,
        };
        // A clip is ended by every request except the one for its next picture.
        self.takes_clip =
            matches!(ask, CameraRequest::BeginClip(_)) || self.takes_clip && ask == CameraRequest::NextPicture;
        let during = ask.describe();
        let mut tries = 0;
        loop {
            tries += 1;
            let from_ns = if ask == CameraRequest::NextPicture { self.clip_from_ns } else { now_ns() };
            let message = match self.send_request(&request, within) {
                Ok(answer) => match self.check_answer(ask, from_ns, answer) {
                    // The camera may have delivered the previous data once more from its own buffer, so one more
                    // attempt is made.
                    Err(ZividFault::Frozen(_)) if tries < 2 => continue,
                    other => return other.inspect_err(|fault| self.shared.record_fault(fault)),
                },
                Err(RequestFailure::Lost(error)) => {
                    return Err(self.on_worker_lost(during, WorkerLoss::from_wire_error(error, within)));
                }
                Err(RequestFailure::Refused(refusal)) => {
                    if let Some(fault) = self.refused(ask, &refusal) {
                        return Err(fault);
                    }
                    refusal.message
                }
            };
            if tries >= MAX_ATTEMPTS {
                let fault = ZividFault::NoShot { during, tries, message };
                self.shared.record_fault(&fault);
                return Err(fault);
            }
        }
    }

    /// Returns the fault for a refused request; `None` if another attempt may succeed.
    fn refused(&mut self, ask: CameraRequest, refusal: &Refusal) -> Option<ZividFault> {
        let (during, message) = (ask.describe(), refusal.message.clone());
        let is_shot = matches!(ask, CameraRequest::Scan | CameraRequest::Picture);
        match refusal.trouble {
            Trouble::Gone | Trouble::NotFound | Trouble::Firmware | Trouble::InUse | Trouble::OutOfReach => {
                let fault = ZividFault::Lost { during, message };
                self.search = Instant::now();
                self.on_camera_missing(fault.clone());
                Some(fault)
            }
            Trouble::NoShot if is_shot => None,
            Trouble::NoShot => Some(ZividFault::NoShot { during, tries: 1, message }),
            Trouble::Settings | Trouble::OutOfOrder => Some(ZividFault::OutOfOrder { during, message }),
        }
        .inspect(|fault| {
            if !matches!(fault, ZividFault::Lost { .. }) {
                self.shared.record_fault(fault);
            }
        })
    }

    /// Checks the reply of the worker against the request.
    fn check_answer(
        &mut self,
        ask: CameraRequest,
        from_ns: u64,
        answer: Answer,
    ) -> Result<CameraAnswer, ZividFault> {
        match (ask, answer) {
            (CameraRequest::Scan, Answer::Scan(came, planes)) => {
                self.accept_shot(ask, from_ns, &came, false)?;
                accept::accept_points(&planes)?;
                if came.metadata.throttled_ms > 0.0 {
                    tracing::warn!("the 3D camera paused for {:.0} ms to cool", came.metadata.throttled_ms);
                }
                Ok(CameraAnswer::Scan(came, planes))
            }
            (CameraRequest::Picture | CameraRequest::NextPicture, Answer::Picture(came, rgb)) => {
                // Pictures of a completely black or white scene are equal without a fault of the camera; the evaluation
                // of the pictures reports such scenes.
                let is_plain = rgb.windows(2).all(|two| two[0] == two[1]);
                self.accept_shot(ask, from_ns, &came, is_plain)?;
                accept::accept_pause(&came.metadata, ask.describe())?;
                Ok(CameraAnswer::Picture(came, rgb))
            }
            (CameraRequest::BeginClip(_), Answer::Words(Reply::ClipBegun)) => Ok(CameraAnswer::Done),
            (CameraRequest::EndClip, Answer::Words(Reply::ClipEnded(end))) => Ok(CameraAnswer::Clip(end)),
            (CameraRequest::Intrinsics, Answer::Words(Reply::Intrinsics(lens))) => Ok(CameraAnswer::Lens(lens)),
            (CameraRequest::Check, Answer::Words(Reply::State(temperatures))) => {
                self.shared.record_temperature(now_ns(), temperatures.lens_c);
                Ok(CameraAnswer::State(temperatures))
            }
            (CameraRequest::Light, Answer::Words(Reply::Light(light))) => Ok(CameraAnswer::Light(light)),
            (_, other) => Err(self.on_worker_lost(ask.describe(), WorkerLoss::Damaged(answer_name(&other)))),
        }
    }

    fn accept_shot(
        &mut self,
        ask: CameraRequest,
        from_ns: u64,
        came: &ShotDelivery,
        may_repeat: bool,
    ) -> Result<(), ZividFault> {
        let is_file = matches!(self.setup.source, Source::File(_));
        let (size, last_number) = (self.setup.size, self.last_number);
        let serial = self.camera.as_ref().map(|camera| camera.serial.clone()).unwrap_or_default();
        let taking = if ask == CameraRequest::Scan { &mut self.scan } else { &mut self.picture };
        let last_sum = taking.last_sum.filter(|_| !is_file && !may_repeat);
        let settings = taking.hash.clone();
        let until_ns = came.arrived_ns;
        let asked =
            ExpectedShot { what: ask.describe(), settings, serial, size, from_ns, until_ns, last_number, last_sum };
        accept::accept(&came.metadata, came.sum, &asked)?;
        taking.last_sum = Some(came.sum);
        self.last_number = came.metadata.number;
        self.shared.record_temperature(came.metadata.exposed_ns, came.metadata.lens_c);
        Ok(())
    }
}
