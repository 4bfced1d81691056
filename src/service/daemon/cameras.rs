//! The cell's cameras as one port.

use super::ports::{CameraAnswer, CameraCommand, CameraFault, Port};
use panelprep_devices::cameras::{CameraError, FlangeCamera, Scanner};

/// A scanner and a flange camera.
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
