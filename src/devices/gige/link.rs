//! The thread of a GigE Vision camera: it owns the connection, captures pictures on request, and reconnects to a camera
//! whose connection was lost.
//!
//! A camera may be unplugged, may reboot, or may never have been connected. The log contains one entry when the camera
//! becomes unavailable and one when it is available again. In between, every request for a picture is refused
//! immediately with the reason, so no caller waits for an unavailable camera.

use super::camera::{ConnectedCamera, Frame, MAX_FIRST_PICTURES};
use super::error::{GigeError, round_to_ms};
use super::settings::{ExposureMode, Settings};
use super::single_picture::{MAX_ATTEMPTS, Statistics};
use crate::UNKNOWN_PX;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time limit for the first search, in addition to the time for the first pictures; then requests are refused.
const SEARCH_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for releasing a camera that does not respond, in addition to the attempts for one picture.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(15);
/// Interval at which the connection is checked while no picture is requested.
const CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// Minimum and maximum interval between two searches for a lost camera; the interval increases from the first to the
/// second.
const MIN_SEARCH_INTERVAL: Duration = Duration::from_millis(200);
const MAX_SEARCH_INTERVAL: Duration = Duration::from_secs(2);

/// The state of the link to a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum LinkStatus {
    /// The first search for the camera is in progress.
    Searching,
    /// The camera delivers.
    Connected,
    /// The camera is unavailable; the error is the reason.
    Away(GigeError),
}

/// A request to the camera's thread.
enum CameraRequest {
    /// Requests a single picture, or the next picture of a free-running camera.
    Picture { asked: Instant, reply: Sender<Result<Frame, GigeError>> },
}

#[derive(Debug)]
struct Shared {
    status: LinkStatus,
    /// The statistics of all connections, including the current one.
    statistics: Statistics,
}

/// A GigE Vision camera whose thread keeps it connected.
#[derive(Debug)]
pub struct GigeCamera {
    asks: Option<Sender<CameraRequest>>,
    shared: Arc<Mutex<Shared>>,
    opened: Instant,
    /// The description of the camera in messages.
    which: String,
    /// Time limits for the first search, and for one picture with all its attempts.
    search: Duration,
    max_wait: Duration,
    is_ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl GigeCamera {
    /// Starts to search for the camera. A missing camera is not an error here, because it may be connected afterwards.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn open(settings: Settings) -> std::io::Result<Self> {
        let (asks, asked) = mpsc::channel();
        let standing = LinkStatus::Searching;
        let shared = Arc::new(Mutex::new(Shared { status: standing, statistics: Statistics::default() }));
        let search = SEARCH_TIMEOUT + MAX_FIRST_PICTURES * settings.picture_timeout();
        let longest = RELEASE_TIMEOUT + MAX_ATTEMPTS * settings.picture_timeout();
        let is_ending = Arc::new(AtomicBool::new(false));
        let mut link = Link {
            settings,
            is_ending: is_ending.clone(),
            max_wait: longest,
            shared: shared.clone(),
            connected: None,
            earlier_counts: Statistics::default(),
            away_since: None,
            next_search: Instant::now(),
            pause: MIN_SEARCH_INTERVAL,
        };
        let which = link.settings.selector.to_string();
        let thread = std::thread::Builder::new().name("gige".to_owned()).spawn(move || link.serve(&asked))?;
        let (asks, opened, thread) = (Some(asks), Instant::now(), Some(thread));
        Ok(GigeCamera { asks, shared, opened, which, search, max_wait: longest, is_ending, thread })
    }

    /// Returns a single picture, or the next picture of a free-running camera.
    ///
    /// # Errors
    /// If the camera is unavailable or delivers no usable picture.
    pub fn picture(&mut self) -> Result<Frame, GigeError> {
        self.check_ready()?;
        let lost = || GigeError::Lost { why: "the camera's thread has ended: restart the service".to_owned() };
        let (reply, answer) = mpsc::channel();
        let asked = Instant::now();
        self.asks.as_ref().ok_or_else(lost)?.send(CameraRequest::Picture { asked, reply }).map_err(|_| lost())?;
        loop {
            match answer.recv_timeout(CHECK_INTERVAL) {
                Ok(picture) => return picture,
                Err(RecvTimeoutError::Disconnected) => return Err(lost()),
                Err(RecvTimeoutError::Timeout) => {
                    if let LinkStatus::Away(why) = self.link_status() {
                        return Err(why);
                    }
                    if asked.elapsed() > self.max_wait {
                        return Err(GigeError::Timeout { waited_ms: round_to_ms(self.max_wait) });
                    }
                }
            }
        }
    }

    /// Checks that the camera is available. Waits until the first search has ended.
    ///
    /// # Errors
    /// If the camera is unavailable.
    pub fn check_ready(&mut self) -> Result<(), GigeError> {
        loop {
            match self.link_status() {
                LinkStatus::Connected => return Ok(()),
                LinkStatus::Away(why) => return Err(why),
                LinkStatus::Searching if self.opened.elapsed() > self.search => {
                    let found = format!("the search has lasted {} s", self.search.as_secs());
                    return Err(GigeError::NotFound { wanted: self.which.clone(), found });
                }
                LinkStatus::Searching => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    /// Returns the current state of the link.
    pub fn link_status(&self) -> LinkStatus {
        lock(&self.shared).status.clone()
    }

    /// Returns the statistics of the link.
    pub fn statistics(&self) -> Statistics {
        lock(&self.shared).statistics
    }

    /// Returns a monitor by which other threads can read the state and the statistics of the link.
    pub fn gauge(&self) -> LinkMonitor {
        LinkMonitor(self.shared.clone())
    }
}

/// A read-only view of a camera's link: it reports state and statistics while another thread uses the camera.
#[derive(Debug, Clone)]
pub struct LinkMonitor(Arc<Mutex<Shared>>);

impl LinkMonitor {
    /// Returns the current state of the link.
    pub fn link_status(&self) -> LinkStatus {
        lock(&self.0).status.clone()
    }

    /// Returns the current statistics of the link.
    pub fn statistics(&self) -> Statistics {
        lock(&self.0).statistics
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        self.is_ending.store(true, Ordering::Relaxed);
        self.asks = None;
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = thread.join();
        }
    }
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The state of the link's thread.
struct Link {
    settings: Settings,
    is_ending: Arc<AtomicBool>,
    max_wait: Duration,
    shared: Arc<Mutex<Shared>>,
    connected: Option<ConnectedCamera>,
    /// The statistics of the connections that have ended.
    earlier_counts: Statistics,
    away_since: Option<Instant>,
    next_search: Instant,
    pause: Duration,
}

impl Link {
    fn serve(&mut self, asked: &Receiver<CameraRequest>) {
        loop {
            if self.connected.is_none() && Instant::now() >= self.next_search {
                self.search();
            }
            match asked.recv_timeout(CHECK_INTERVAL) {
                Ok(CameraRequest::Picture { asked, reply }) if asked.elapsed() < self.max_wait => {
                    let picture = self.picture();
                    if let Some(why) = picture.as_ref().err().filter(|_| self.connected.is_some()) {
                        self.on_lost(why.clone());
                    }
                    let is_lost = picture.is_err();
                    #[expect(
                        clippy::let_underscore_must_use,
                        reason = "sending fails only if the caller no longer waits for the reply"
                    )]
                    let _ = reply.send(picture);
                    if is_lost {
                        self.release_camera();
                    }
                }
                Ok(CameraRequest::Picture { .. }) => {}
                Err(RecvTimeoutError::Timeout) => {
                    if let Some(why) =
                        self.connected.as_ref().and_then(|connected| connected.check_connected().err())
                    {
                        self.on_lost(why);
                        self.release_camera();
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    self.publish();
                    tracing::info!("{}: {}", self.settings.selector, lock(&self.shared).statistics);
                    return;
                }
            }
        }
    }

    fn picture(&mut self) -> Result<Frame, GigeError> {
        let Some(connected) = &mut self.connected else {
            let away = match &lock(&self.shared).status {
                LinkStatus::Away(why) => why.clone(),
                _ => GigeError::Lost { why: "the program is searching for the camera".to_owned() },
            };
            return Err(away);
        };
        let picture = match self.settings.exposure_mode {
            ExposureMode::Triggered => connected.capture_single_picture(),
            ExposureMode::FreeRunning { .. } => connected.next(),
        };
        self.publish();
        picture
    }

    fn search(&mut self) {
        match ConnectedCamera::open(&self.settings, self.is_ending.clone()) {
            Ok(connected) => {
                self.connected = Some(connected);
                self.earlier_counts.connections += 1;
                self.pause = MIN_SEARCH_INTERVAL;
                lock(&self.shared).status = LinkStatus::Connected;
                self.publish();
                if let Some(since) = self.away_since.take() {
                    let away_s = since.elapsed().as_secs_f64();
                    tracing::info!("{} is available again after {away_s:.1} s", self.settings.selector);
                }
            }
            Err(why) => {
                self.next_search = Instant::now() + self.pause;
                self.pause = (self.pause * 2).min(MAX_SEARCH_INTERVAL);
                self.report_away(why);
            }
        }
    }

    /// Releases a connected camera that delivers no picture, and reports the reason.
    fn on_lost(&mut self, why: GigeError) {
        self.earlier_counts.losses += 1;
        self.publish();
        self.report_away(why);
    }

    /// Releases the camera. When it is opened again, all settings are written again, because they may have changed.
    fn release_camera(&mut self) {
        let Some(connected) = self.connected.take() else { return };
        self.earlier_counts = self.earlier_counts.plus(connected.statistics());
        self.next_search = Instant::now() + self.pause;
        // This takes several seconds if the camera does not respond.
        drop(connected);
    }

    /// Logs once that the camera is unavailable; the reason may change while it is.
    fn report_away(&mut self, why: GigeError) {
        if self.away_since.is_none() {
            match why {
                GigeError::WrongSize { expected_px: UNKNOWN_PX, .. } => tracing::debug!("{why}"),
                _ => tracing::warn!("{why}"),
            }
            self.away_since = Some(Instant::now());
        }
        lock(&self.shared).status = LinkStatus::Away(why);
    }

    fn publish(&mut self) {
        let now = self.connected.as_ref().map(ConnectedCamera::statistics).unwrap_or_default();
        lock(&self.shared).statistics = self.earlier_counts.plus(now);
    }
}
