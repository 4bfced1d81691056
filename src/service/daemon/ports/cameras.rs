//! The interface of the loop to the cameras, and the cameras of the cell as one port. Each command captures one picture
//! or scan when it is performed.

use super::port::{Command, Port};
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};
pub use panelprep_devices::cameras::Picture as Picture2d;
use panelprep_devices::cameras::{CameraError, FlangeCamera, Scanner};
use serde::Serialize;

/// The commands to the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraCommand {
    /// Captures a 3D scan.
    Scan,
    /// Captures a picture with the colour sensor of the 3D camera.
    Picture,
    /// Begins a film: pictures of the colour sensor one after the other, at most this number per second. If no command
    /// ends the film, it ends automatically.
    BeginFilm(f64),
    /// Fetches the next picture of the film. A gap in the times indicates dropped pictures before it.
    NextOfFilm,
    /// Ends the film.
    EndFilm,
    /// Captures a picture with the flange camera.
    CornerPicture,
    /// Checks whether the cameras can deliver pictures, without a picture that a cycle uses.
    Check,
}

/// The answers of the cameras.
#[derive(Debug)]
pub enum CameraAnswer {
    /// Answer to `Scan`.
    Scan(OrganizedCloud<Camera>),
    /// Answer to `Picture` and `NextOfFilm`; the time is on the clock of the camera.
    Picture(Picture2d),
    /// Answer to `NextOfFilm` if no picture is available yet.
    NoneDue,
    /// Answer to `BeginFilm`: the start time on the clock of the pictures, s.
    FilmBegan(f64),
    /// Answer to `EndFilm`: the number of dropped pictures.
    FilmEnded(u64),
    /// Answer to `CornerPicture`.
    Corner(ColorPicture),
    /// Answer to `Check`: each camera that cannot deliver pictures, with the reason.
    Checked(Vec<CameraFault>),
}

impl Command for CameraCommand {
    type Answer = Result<CameraAnswer, CameraFault>;
}

/// Error: a camera delivered no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{camera} delivered no picture: {why}")]
pub struct CameraFault {
    /// The camera.
    pub camera: &'static str,
    /// Its message.
    pub why: String,
}

impl CameraFault {
    /// Returns the error for an answer to a different command; no port gives such an answer.
    fn mismatch_error<T>() -> Result<T, Self> {
        Err(CameraFault {
            camera: "a camera",
            why: "internal fault: the answer of the cameras does not match the command; report this".to_owned(),
        })
    }
}

/// The commands of the cameras as functions. They fail if the camera delivers no picture.
pub trait CameraPort: Port<CameraCommand> {
    /// Captures a 3D scan.
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, CameraFault> {
        let CameraAnswer::Scan(cloud) = self.perform(CameraCommand::Scan)? else {
            return CameraFault::mismatch_error();
        };
        Ok(cloud)
    }

    /// Captures a picture with the colour sensor of the 3D camera.
    fn picture(&mut self) -> Result<Picture2d, CameraFault> {
        let taken = self.perform(CameraCommand::Picture)?;
        let CameraAnswer::Picture(picture) = taken else { return CameraFault::mismatch_error() };
        Ok(picture)
    }

    /// Begins a film with at most this number of pictures per second; returns the start time on the clock of the
    /// pictures, s.
    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, CameraFault> {
        let begun = self.perform(CameraCommand::BeginFilm(pictures_per_second))?;
        let CameraAnswer::FilmBegan(time_s) = begun else { return CameraFault::mismatch_error() };
        Ok(time_s)
    }

    /// Fetches the next picture of the film; `None` if no picture is available yet.
    fn next_film_picture(&mut self) -> Result<Option<Picture2d>, CameraFault> {
        match self.perform(CameraCommand::NextOfFilm)? {
            CameraAnswer::Picture(picture) => Ok(Some(picture)),
            CameraAnswer::NoneDue => Ok(None),
            _ => CameraFault::mismatch_error(),
        }
    }

    /// Ends the film; returns the number of its dropped pictures.
    fn end_film(&mut self) -> Result<u64, CameraFault> {
        let ended = self.perform(CameraCommand::EndFilm)?;
        let CameraAnswer::FilmEnded(dropped) = ended else { return CameraFault::mismatch_error() };
        Ok(dropped)
    }

    /// Captures a picture with the flange camera.
    fn corner_picture(&mut self) -> Result<ColorPicture, CameraFault> {
        let taken = self.perform(CameraCommand::CornerPicture)?;
        let CameraAnswer::Corner(picture) = taken else { return CameraFault::mismatch_error() };
        Ok(picture)
    }

    /// Returns the faults of the cameras that cannot deliver pictures.
    fn check_cameras(&mut self) -> Vec<CameraFault> {
        match self.perform(CameraCommand::Check) {
            Ok(CameraAnswer::Checked(faults)) => faults,
            Ok(_) => vec![],
            Err(fault) => vec![fault],
        }
    }
}

impl<P: Port<CameraCommand> + ?Sized> CameraPort for P {}

/// Placeholder for operations that capture no picture, such as clearing an abort.
#[derive(Debug)]
pub struct NoCameras;

impl Port<CameraCommand> for NoCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        match command {
            CameraCommand::Check => Ok(CameraAnswer::Checked(vec![])),
            _ => Err(CameraFault { camera: "the camera", why: "this command needs no camera".to_owned() }),
        }
    }
}

/// The 3D camera and the flange camera of a cell.
#[derive(Debug)]
pub struct Cameras<S, F> {
    /// The 3D camera.
    pub scanner: S,
    /// The camera on the flange.
    pub flange: F,
}

impl<S: Scanner, F: FlangeCamera> Port<CameraCommand> for Cameras<S, F> {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        let Cameras { scanner, flange } = self;
        let taken = match command {
            CameraCommand::Scan => scanner.capture_3d().map(|shot| CameraAnswer::Scan(shot.cloud)),
            CameraCommand::Picture => scanner.capture_2d().map(CameraAnswer::Picture),
            CameraCommand::BeginFilm(per_second) => scanner.begin_clip(per_second).map(CameraAnswer::FilmBegan),
            CameraCommand::NextOfFilm => {
                scanner.next_clip_picture().map(|next| next.map_or(CameraAnswer::NoneDue, CameraAnswer::Picture))
            }
            CameraCommand::EndFilm => scanner.end_clip().map(CameraAnswer::FilmEnded),
            CameraCommand::CornerPicture => {
                let taken = flange.capture().map(|shot| CameraAnswer::Corner(shot.picture));
                return taken.map_err(|error| camera_fault("the flange camera", &error));
            }
            CameraCommand::Check => {
                let scanner = scanner.check_ready().map_err(|error| camera_fault("the scanner", &error));
                let flange = flange.check_ready().map_err(|error| camera_fault("the flange camera", &error));
                Ok(CameraAnswer::Checked([scanner, flange].into_iter().filter_map(Result::err).collect()))
            }
        };
        taken.map_err(|error| camera_fault("the scanner", &error))
    }
}

fn camera_fault(camera: &'static str, error: &CameraError) -> CameraFault {
    CameraFault { camera, why: error.to_string() }
}
