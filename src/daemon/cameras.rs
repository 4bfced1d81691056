//! The cell's cameras as the loop's eyes.

use super::ports::{Eyes, Picture2d, SightError};
use crate::devices::cameras::{CameraError, FlangeCamera, Scanner};
use crate::geometry::{Camera, ColorPicture, OrganizedCloud};

/// A scanner and a flange camera.
#[derive(Debug)]
pub struct Cameras<S, F> {
    /// The 3D camera.
    pub scanner: S,
    /// The camera on the flange.
    pub flange: F,
}

impl<S: Scanner, F: FlangeCamera> Eyes for Cameras<S, F> {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        self.scanner.capture_3d().map(|shot| shot.cloud).map_err(|error| blind("the scanner", &error))
    }

    fn picture(&mut self) -> Result<Picture2d, SightError> {
        self.scanner.capture_2d().map_err(|error| blind("the scanner", &error))
    }

    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError> {
        self.scanner.begin_clip(pictures_per_second).map_err(|error| blind("the scanner", &error))
    }

    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError> {
        self.scanner.next_of_clip().map_err(|error| blind("the scanner", &error))
    }

    fn end_film(&mut self) -> Result<u64, SightError> {
        self.scanner.end_clip().map_err(|error| blind("the scanner", &error))
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        self.flange.capture().map(|shot| shot.picture).map_err(|error| blind("the flange camera", &error))
    }

    fn check(&mut self) -> Vec<SightError> {
        let scanner = self.scanner.check().map_err(|error| blind("the scanner", &error));
        let flange = self.flange.check().map_err(|error| blind("the flange camera", &error));
        [scanner, flange].into_iter().filter_map(Result::err).collect()
    }
}

fn blind(camera: &'static str, error: &CameraError) -> SightError {
    SightError { camera, why: error.to_string() }
}
