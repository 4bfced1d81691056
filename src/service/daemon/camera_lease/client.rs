//! The client of the service's cameras, for commands of this program.

use super::super::protocol::request_line;
use super::super::request::{Reply, RequestKind};
use super::request::{ShotHeader, ShotRequest};
use super::shared::AT_WORK_CODE;
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};
use panelprep_cell::files;
use panelprep_devices::cameras::{
    CameraError, CameraRole, Conditions, FlangeCamera, FlangePicture, Picture, Scanner, Shot,
};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

/// Maximum time to wait for a response. Within this time, the service itself reports a camera that has stopped
/// delivering.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(120);
/// Maximum size of a header, and below it of a shot (100 million points), bytes.
const MAX_HEAD_BYTES: u64 = 64 * 1_024;
const MAX_SHOT_BYTES: usize = 2_000_000_000;

type Connection = BufReader<UnixStream>;

/// The service's 3D camera, used over the service's socket.
#[derive(Debug)]
pub struct RemoteScanner {
    socket: PathBuf,
    film: Option<Connection>,
    conditions: Conditions,
}

/// The service's flange camera, used over the service's socket.
#[derive(Debug)]
pub struct BorrowedFlangeCamera {
    socket: PathBuf,
    conditions: Conditions,
}

impl RemoteScanner {
    /// Creates a client for the 3D camera of the service at this socket.
    pub fn new(socket: PathBuf) -> Self {
        RemoteScanner { socket, film: None, conditions: Conditions::default() }
    }
}

impl BorrowedFlangeCamera {
    /// Creates a client for the flange camera of the service at this socket.
    pub fn new(socket: PathBuf) -> Self {
        BorrowedFlangeCamera { socket, conditions: Conditions::default() }
    }
}

fn connection_error(problem: impl std::fmt::Display) -> CameraError {
    CameraError::Service { problem: problem.to_string() }
}

/// Requests shots.
fn request_shots(socket: &PathBuf, shot: ShotRequest) -> Result<Connection, CameraError> {
    let mut stream = UnixStream::connect(socket).map_err(connection_error)?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT)).map_err(connection_error)?;
    stream.set_write_timeout(Some(RESPONSE_TIMEOUT)).map_err(connection_error)?;
    stream
        .write_all(request_line(&RequestKind::Shoot(shot)).map_err(connection_error)?.as_bytes())
        .map_err(connection_error)?;
    Ok(BufReader::new(stream))
}

/// The next head.
fn head(connection: &mut Connection) -> Result<ShotHeader, CameraError> {
    let mut line = Vec::new();
    connection.by_ref().take(MAX_HEAD_BYTES).read_until(b'\n', &mut line).map_err(connection_error)?;
    match serde_json::from_slice(&line) {
        Ok(ShotHeader::Failed { reasons }) if reasons.iter().any(|reason| reason.code == AT_WORK_CODE) => {
            Err(CameraError::AtWork)
        }
        Ok(ShotHeader::Failed { reasons }) => Err(connection_error(describe_reasons(&reasons))),
        Ok(sent) => Ok(sent),
        // If the service refused the request before it reached the cameras, it sends an ordinary reply.
        Err(error) => match serde_json::from_slice::<Reply>(&line) {
            Ok(reply) => Err(connection_error(describe_reasons(&reply.reasons))),
            Err(_) => Err(connection_error(format!("the response of the service cannot be decoded: {error}"))),
        },
    }
}

fn describe_reasons(reasons: &[panelprep_base::verdict::Reason]) -> String {
    reasons.iter().map(|reason| reason.message.as_ref()).collect::<Vec<_>>().join("; ")
}

fn body(connection: &mut Connection, bytes: usize) -> Result<Vec<u8>, CameraError> {
    if bytes > MAX_SHOT_BYTES {
        return Err(connection_error(format!(
            "the header from the service states a shot of {bytes} bytes (limit {MAX_SHOT_BYTES} bytes); use the same \
             version of the program for the service and the command"
        )));
    }
    let mut body = Vec::new();
    let read = connection.take(bytes as u64).read_to_end(&mut body).map_err(connection_error)?;
    if read == bytes {
        Ok(body)
    } else {
        Err(connection_error(format!("connection closed by the service after {read} of {bytes} bytes")))
    }
}

fn read_colors(connection: &mut Connection, width: usize, height: usize) -> Result<ColorPicture, CameraError> {
    let bytes = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(3));
    let body = body(connection, bytes.unwrap_or(usize::MAX))?;
    let (rgb, _) = body.as_chunks::<3>();
    Ok(ColorPicture { width, height, rgb: rgb.to_vec() })
}

fn unexpected_header_error(sent: &ShotHeader) -> CameraError {
    let what = match sent {
        ShotHeader::Scan { .. } => "a scan",
        ShotHeader::Picture { .. } => "a picture",
        ShotHeader::Began { .. } => "the beginning of a film",
        ShotHeader::Ended { .. } => "the end of a film",
        ShotHeader::Failed { .. } => "a failure",
    };
    connection_error(format!(
        "the service sent {what}, which was not requested; use the same version of the program \
                              for the service and the command"
    ))
}

impl Scanner for RemoteScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        self.film = None;
        let mut connection = request_shots(&self.socket, ShotRequest::Scan)?;
        match head(&mut connection)? {
            ShotHeader::Scan { bytes, time_s, conditions } => {
                self.conditions = conditions;
                let body = body(&mut connection, bytes)?;
                let cloud: OrganizedCloud<Camera> = files::read_any_cloud(&body, None).map_err(connection_error)?;
                Ok(Shot { cloud, time_s })
            }
            sent => Err(unexpected_header_error(&sent)),
        }
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        self.film = None;
        let mut connection = request_shots(&self.socket, ShotRequest::Picture)?;
        match head(&mut connection)? {
            ShotHeader::Picture { width_px, height_px, time_s, conditions } => {
                self.conditions = conditions;
                Ok(Picture { picture: read_colors(&mut connection, width_px, height_px)?, time_s })
            }
            sent => Err(unexpected_header_error(&sent)),
        }
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        self.film = None;
        let mut connection = request_shots(&self.socket, ShotRequest::Film { pictures_per_second })?;
        match head(&mut connection)? {
            ShotHeader::Began { time_s } => {
                self.film = Some(connection);
                Ok(time_s)
            }
            sent => Err(unexpected_header_error(&sent)),
        }
    }

    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        let Some(film) = &mut self.film else { return Err(CameraError::NoClip { which: CameraRole::Scanner }) };
        match head(film)? {
            ShotHeader::Picture { width_px, height_px, time_s, conditions } => {
                self.conditions = conditions;
                Ok(Some(Picture { picture: read_colors(film, width_px, height_px)?, time_s }))
            }
            sent => Err(unexpected_header_error(&sent)),
        }
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        let Some(mut film) = self.film.take() else {
            return Err(CameraError::NoClip { which: CameraRole::Scanner });
        };
        film.get_ref().shutdown(Shutdown::Write).map_err(connection_error)?;
        loop {
            match head(&mut film)? {
                ShotHeader::Ended { dropped } => return Ok(dropped),
                // The client requested the end of the film while this picture was already being sent.
                ShotHeader::Picture { width_px, height_px, .. } => {
                    drop(read_colors(&mut film, width_px, height_px)?)
                }
                sent => return Err(unexpected_header_error(&sent)),
            }
        }
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.capture_2d().map(drop)
    }

    fn conditions(&self) -> Conditions {
        self.conditions
    }
}

impl FlangeCamera for BorrowedFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let mut connection = request_shots(&self.socket, ShotRequest::Corner)?;
        match head(&mut connection)? {
            ShotHeader::Picture { width_px, height_px, time_s, conditions } => {
                self.conditions = conditions;
                let picture = read_colors(&mut connection, width_px, height_px)?;
                Ok(FlangePicture { picture, base_from_flange: None, time_s })
            }
            sent => Err(unexpected_header_error(&sent)),
        }
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.capture().map(drop)
    }

    fn conditions(&self) -> Conditions {
        self.conditions
    }
}
