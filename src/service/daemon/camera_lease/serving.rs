//! One connection that requests shots.

use super::capture::{CameraEye, TakenPicture};
use super::header::ShotHeader;
use super::request::ShotRequest;
use super::shared::{CameraLease, SharedCameras};
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::Reason;
use panelprep_cell::files;
use panelprep_devices::cameras::{CameraError, Conditions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// Time limit for a client to accept the data that is sent to it.
const CLIENT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for which the service waits before each picture for the client to end the film.
const END_POLL_TIMEOUT: Duration = Duration::from_millis(2);
/// No camera takes more pictures a second than this.
const MAX_PICTURES_PER_SECOND: f64 = 100.0;

/// The reason why a connection ends before its normal end.
enum ConnectionEnd {
    /// The reason is reported to the client.
    Refused(Vec<Reason>),
    /// There is no client to report to.
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

/// Takes the requested shots and sends them, until the client has enough or the cell is no longer at rest.
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
    let TakenPicture { picture: taken, time_s, conditions } = lent.capture(eye)?;
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
    // However the film ended, the camera's clip must be ended, unless the loop has already ended it: the next shot
    // needs the camera in its previous state.
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
