//! The service's cameras: the client that uses them, captured pictures with the conditions that the camera reports, and
//! the server side of a connection that requests shots.

use super::request::{ShotHeader, ShotRequest};
use crate::daemon::ports::{CameraAnswer, CameraCommand, CameraFault, CameraPort as _, Cameras, LastState, Port};
use panelprep_base::geometry::{Camera, ColorPicture, Joints, OrganizedCloud};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::State;
use panelprep_cell::files;
use panelprep_devices::cameras::{CameraError, Conditions, FlangeCamera, Scanner};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The cell's cameras, with any driver.
pub type AllCameras = Cameras<Box<dyn Scanner>, Box<dyn FlangeCamera>>;

/// Maximum time that a request for a shot waits until another request has ended.
const LEND_TIMEOUT: Duration = Duration::from_secs(1);

/// The reason code for a refused shot while the cell works.
pub(super) const AT_WORK_CODE: &str = "at_work";

pub(super) struct Inside {
    pub(super) cameras: AllCameras,
    /// Whether a client is recording a film.
    pub(super) films: bool,
}

/// The service's cameras. Clones share the same cameras.
#[derive(Clone)]
pub struct SharedCameras(Arc<Shared>);

struct Shared {
    inside: Mutex<Inside>,
    last: LastState,
    /// Whether the cell is idle, without a cycle.
    is_at_rest: AtomicBool,
    is_lent: AtomicBool,
}

impl SharedCameras {
    /// Shares the cameras of a cell; `last` is the last state of its robot.
    pub fn new(cameras: AllCameras, last: LastState) -> Self {
        let (rests, is_lent) = (AtomicBool::new(false), AtomicBool::new(false));
        let inside = Mutex::new(Inside { cameras, films: false });
        SharedCameras(Arc::new(Shared { inside, last, is_at_rest: rests, is_lent }))
    }

    /// Records whether the cell is idle in this state.
    pub(in crate::daemon) fn set_cell_state(&self, state: &State) {
        self.0.is_at_rest.store(state.at.is_at_rest() && !state.job.running, Ordering::Relaxed);
    }

    /// Reserves the cameras for an operation of the cell: they are not lent until the next report of the cell's state.
    pub(in crate::daemon) fn reserve(&self) {
        self.0.is_at_rest.store(false, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Uses the cameras for the loop. If a client is recording a film, the film is ended first.
    fn with_cameras<T>(&self, act: impl FnOnce(&mut AllCameras) -> T) -> T {
        let mut inside = self.lock();
        if std::mem::take(&mut inside.films) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the film of a client was ended, because the cell needs the camera"
            )]
            let _ = inside.cameras.scanner.end_clip();
        }
        act(&mut inside.cameras)
    }

    /// Lends the cameras to a client, or returns the reason why this is not possible. Waits for a short time, because a
    /// connection that has just sent the last byte of a shot may not have returned the cameras yet.
    pub(super) fn lend(&self) -> Result<CameraLease<'_>, Reason> {
        let since = Instant::now();
        while self.0.is_lent.swap(true, Ordering::Acquire) {
            if since.elapsed() > LEND_TIMEOUT {
                return Err(Reason::new(
                    "busy",
                    "another client is capturing pictures now; try again when it has finished",
                ));
            }
            thread::sleep(Duration::from_millis(2));
        }
        Ok(CameraLease(self))
    }

    /// Returns the positions of the axes if the arm is stationary and its state is recent.
    pub(in crate::daemon) fn resting_joints(&self) -> Option<Joints> {
        self.0.last.resting_joints()
    }
}

impl std::fmt::Debug for SharedCameras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedCameras")
            .field("rests", &self.0.is_at_rest)
            .field("is_lent", &self.0.is_lent)
            .finish()
    }
}

/// The cameras while they are lent to a client; dropping this value returns them.
pub(super) struct CameraLease<'a>(&'a SharedCameras);

impl Drop for CameraLease<'_> {
    fn drop(&mut self) {
        self.0.0.is_lent.store(false, Ordering::Release);
    }
}

impl CameraLease<'_> {
    /// Locks the cameras, whether or not the cell is still idle.
    pub(super) fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock()
    }

    /// Returns the cameras for one shot, or for one picture of a film, if the cell is still idle.
    pub(super) fn cameras(&self) -> Result<MutexGuard<'_, Inside>, Reason> {
        let inside = self.0.lock();
        // Checked after the cameras are locked: if the loop needs the cameras after this check, it waits until this
        // shot has ended.
        if self.0.0.is_at_rest.load(Ordering::Relaxed) {
            return Ok(inside);
        }
        Err(Reason::new(AT_WORK_CODE, "the cell is at work; try again when the cycle has ended"))
    }
}

impl Port<CameraCommand> for SharedCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        self.with_cameras(|cameras| cameras.perform(command))
    }
}

/// One of the two cameras of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::daemon) enum CameraEye {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    Flange,
}

/// A picture captured by one of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::daemon) struct CapturedPicture {
    /// The picture.
    pub picture: ColorPicture,
    /// The time of the picture on the clock of the camera, s.
    pub time_s: f64,
    /// The conditions of the shot, as the camera reports them.
    pub conditions: Conditions,
}

impl CameraLease<'_> {
    /// Captures a picture if the cell is still idle.
    pub(super) fn capture(&self, eye: CameraEye) -> Result<CapturedPicture, Reason> {
        let cameras = &mut self.cameras()?.cameras;
        let failed = |error: CameraError| Reason::new("camera", error.to_string());
        let (picture, time_s, conditions) = match eye {
            CameraEye::Scanner => {
                let shot = cameras.scanner.capture_2d().map_err(failed)?;
                (shot.picture, shot.time_s, cameras.scanner.conditions())
            }
            CameraEye::Flange => {
                let shot = cameras.flange.capture().map_err(failed)?;
                (shot.picture, shot.time_s, cameras.flange.conditions())
            }
        };
        Ok(CapturedPicture { picture, time_s, conditions })
    }
}

impl SharedCameras {
    /// Checks whether both cameras answer, if the cell is idle and no other client uses them. Returns the problems
    /// found.
    pub(in crate::daemon) fn check_cameras(&self) -> Option<Vec<Reason>> {
        let lent = self.lend().ok()?;
        let faults = lent.cameras().ok()?.cameras.check_cameras();
        Some(faults.into_iter().map(|fault| Reason::new("camera", fault.to_string())).collect())
    }

    /// Takes a scan between cycles; the calling thread waits for the camera.
    ///
    /// # Errors
    /// As [`SharedCameras::capture`].
    pub(in crate::daemon) fn capture_3d(&self) -> Result<OrganizedCloud<Camera>, Reason> {
        let shot = self.lend()?.cameras()?.cameras.scanner.capture_3d();
        shot.map(|shot| shot.cloud).map_err(|error| Reason::new("camera", error.to_string()))
    }

    /// Takes a picture between cycles; the calling thread waits for the camera.
    ///
    /// # Errors
    /// If a cycle is running, another client uses the cameras, or the camera delivers no picture.
    pub(in crate::daemon) fn capture(&self, eye: CameraEye) -> Result<CapturedPicture, Reason> {
        self.lend()?.capture(eye)
    }
}

/// Maximum time for a client to accept the data that is sent to it.
const CLIENT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for which the service waits, before each picture of a film, for the client's request to end the film.
const END_POLL_TIMEOUT: Duration = Duration::from_millis(2);
/// Maximum picture rate of any camera, pictures per second.
const MAX_PICTURES_PER_SECOND: f64 = 100.0;

/// The reason why a connection ends before its normal end.
enum ConnectionEnd {
    /// The service refuses the shot; the reasons are sent to the client.
    Refused(Vec<Reason>),
    /// The client has disconnected; nothing can be sent to it.
    HungUp,
}

impl From<std::io::Error> for ConnectionEnd {
    fn from(_: std::io::Error) -> Self {
        ConnectionEnd::HungUp
    }
}

impl From<Reason> for ConnectionEnd {
    fn from(reason: Reason) -> Self {
        ConnectionEnd::Refused(vec![reason])
    }
}

impl From<CameraError> for ConnectionEnd {
    fn from(error: CameraError) -> Self {
        ConnectionEnd::Refused(vec![Reason::new("camera", error.to_string())])
    }
}

/// Captures the requested shots and sends them, until the client has received all of them or a cycle starts.
pub fn serve(mut stream: UnixStream, request: ShotRequest, cameras: &SharedCameras) {
    let sent = serve_shots(&mut stream, request, cameras);
    if let Err(ConnectionEnd::Refused(reasons)) = sent {
        #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
        let _ = head(&mut stream, &ShotHeader::Failed { reasons });
    }
}

fn serve_shots(
    stream: &mut UnixStream,
    request: ShotRequest,
    cameras: &SharedCameras,
) -> Result<(), ConnectionEnd> {
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(CLIENT_TIMEOUT))?;
    stream.set_read_timeout(Some(END_POLL_TIMEOUT))?;
    let lent = cameras.lend()?;
    match request {
        ShotRequest::Scan => {
            let (shot, conditions) = {
                let cameras = &mut lent.cameras()?.cameras;
                (cameras.scanner.capture_3d()?, cameras.scanner.conditions())
            };
            let pcd = files::write_pcd(&shot.cloud);
            head(stream, &ShotHeader::Scan { bytes: pcd.len(), time_s: shot.time_s, conditions })?;
            stream.write_all(&pcd)?;
        }
        ShotRequest::Picture => serve_one(stream, &lent, CameraEye::Scanner)?,
        ShotRequest::Corner => serve_one(stream, &lent, CameraEye::Flange)?,
        ShotRequest::Film { pictures_per_second } => film(stream, pictures_per_second, &lent)?,
    }
    Ok(())
}

fn serve_one(stream: &mut UnixStream, lent: &CameraLease<'_>, eye: CameraEye) -> Result<(), ConnectionEnd> {
    let CapturedPicture { picture: taken, time_s, conditions } = lent.capture(eye)?;
    Ok(picture(stream, &taken, (time_s, conditions))?)
}

fn film(stream: &mut UnixStream, pictures_per_second: f64, lent: &CameraLease<'_>) -> Result<(), ConnectionEnd> {
    if !(pictures_per_second > 0.0 && pictures_per_second <= MAX_PICTURES_PER_SECOND) {
        let message = format!(
            "the rate is {pictures_per_second} pictures per second; valid: more than 0, at most \
             {MAX_PICTURES_PER_SECOND}"
        );
        return Err(Reason::new("bad_request", message).into());
    }
    let time_s = {
        let mut inside = lent.cameras()?;
        let time_s = inside.cameras.scanner.begin_clip(pictures_per_second)?;
        inside.films = true;
        time_s
    };
    let sent = pictures(stream, time_s, lent);
    // The clip of the camera must be ended however the film ended, unless the loop has already ended it: the next shot
    // needs the camera in its normal mode.
    let dropped = {
        let mut inside = lent.lock();
        std::mem::take(&mut inside.films).then(|| inside.cameras.scanner.end_clip())
    };
    sent?;
    Ok(head(stream, &ShotHeader::Ended { dropped: dropped.transpose()?.unwrap_or(0) })?)
}

fn pictures(stream: &mut UnixStream, time_s: f64, lent: &CameraLease<'_>) -> Result<(), ConnectionEnd> {
    head(stream, &ShotHeader::Began { time_s })?;
    while !has_client_finished(stream)? {
        let next = {
            let scanner = &mut lent.cameras()?.cameras.scanner;
            let next = scanner.next_clip_picture()?;
            next.map(|shot| (shot, scanner.conditions()))
        };
        if let Some((shot, conditions)) = next {
            picture(stream, &shot.picture, (shot.time_s, conditions))?;
        }
    }
    Ok(())
}

/// Returns whether the client has closed its writing side.
fn has_client_finished(stream: &mut UnixStream) -> Result<bool, ConnectionEnd> {
    match stream.read(&mut [0; 64]) {
        Ok(0) => Ok(true),
        Ok(_) => Err(Reason::new(
            "bad_request",
            "data was received while a film is being recorded; send nothing, and close the connection to end the \
             film",
        )
        .into()),
        Err(error)
            if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
        {
            Ok(false)
        }
        Err(_) => Err(ConnectionEnd::HungUp),
    }
}

fn picture(
    stream: &mut UnixStream,
    picture: &ColorPicture,
    (time_s, conditions): (f64, Conditions),
) -> std::io::Result<()> {
    let (width_px, height_px) = (picture.width, picture.height);
    head(stream, &ShotHeader::Picture { width_px, height_px, time_s, conditions })?;
    stream.write_all(picture.rgb.as_flattened())
}

fn head(stream: &mut UnixStream, sent: &ShotHeader) -> std::io::Result<()> {
    let mut line = serde_json::to_vec(sent)?;
    line.push(b'\n');
    stream.write_all(&line)
}
