//! A file that shows a board: a picture, or a 3D shot with the points of its pixels.

use super::super::disk;
use super::super::fault::Fault;
use panelprep_base::geometry::{Camera, ColorPicture, GrayPicture, OrganizedCloud, PinholeCamera};
use panelprep_cell::files;
use panelprep_vision::calib::detect::{self, DetectedCorners};
use panelprep_vision::calib::{Board, BoardObservation, CalibError};
use panelprep_vision::locate::ScanErrors;
use std::path::Path;

/// The picture of a file, and its points if it has them.
pub struct BoardImage {
    /// The file's name in messages.
    pub name: String,
    /// SHA-256 of the file.
    pub hash: String,
    /// In grey.
    pub gray: GrayPicture,
    cloud: Option<OrganizedCloud<Camera>>,
}

impl BoardImage {
    /// Reads a picture or a shot (`.pcd`, `.ply`), and checks that it has the camera's size.
    ///
    /// # Errors
    /// If it cannot be read, is of another size, or is a picture other than PNG.
    pub fn read(file: &Path, camera: &PinholeCamera) -> Result<Self, Fault> {
        let bytes = disk::read(file)?;
        let is_shot =
            file.extension().is_some_and(|end| end.eq_ignore_ascii_case("pcd") || end.eq_ignore_ascii_case("ply"));
        let (gray, cloud) = if is_shot {
            let cloud = files::read_cloud(&bytes, camera).map_err(|error| Fault::file_fault(file, error))?;
            (cloud.picture().to_gray(), Some(cloud))
        } else {
            let gray = files::read_measured_gray(&bytes, camera).map_err(|error| Fault::file_fault(file, error))?;
            (gray, None)
        };
        let name = file.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        Ok(BoardImage { name, hash: files::content_hash(&bytes), gray, cloud })
    }

    /// Finds the board's corners.
    ///
    /// # Errors
    /// If it shows no board.
    pub fn detect(&self, board: &Board, half_window_px: Option<usize>) -> Result<DetectedCorners, CalibError> {
        detect::detect(&self.name, &self.gray, board, half_window_px)
    }

    /// Finds the board's corners, but reports first that it searches: a large picture without the board needs a
    /// second.
    ///
    /// # Errors
    /// As [`BoardImage::detect`].
    pub fn detect_telling(
        &self,
        board: &Board,
        half_window_px: Option<usize>,
        progress: &dyn Fn(&str),
    ) -> Result<DetectedCorners, CalibError> {
        let (columns, rows) = (board.columns(), board.rows());
        progress(&format!("{}: searching for a board with {columns}×{rows} inner corners", self.name));
        self.detect(board, half_window_px)
    }

    /// Returns the corners as the 3D camera measured them, corrected for its own errors; `None` for a picture.
    pub fn measured(
        &self,
        (camera, errors): (&PinholeCamera, &ScanErrors),
        detected: &DetectedCorners,
    ) -> Option<BoardObservation<Camera>> {
        let measured = detect::measured(self.cloud.as_ref()?, camera, &detected.corners);
        let BoardObservation::Points(corners) = measured else { return Some(measured) };
        let corrected = |(corner, point)| (corner, errors.corrected_point(point));
        Some(BoardObservation::Points(corners.into_iter().map(corrected).collect()))
    }

    /// Returns the points of the shot; `None` for a picture.
    pub fn cloud(&self) -> Option<&OrganizedCloud<Camera>> {
        self.cloud.as_ref()
    }

    /// Returns the picture in colour, so that results can be drawn on it.
    pub fn color(&self) -> ColorPicture {
        self.gray.to_color()
    }
}
