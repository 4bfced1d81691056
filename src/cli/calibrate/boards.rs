//! Calibration boards: the board that the arguments state, a fixed board whose kind and pose are in a target file, and
//! a file in which the board is detected (a picture, or a 3D scan with its points).

use super::super::disk;
use super::super::fault::Fault;
use super::args::{BoardArgs, NamedBoard};
use panelprep_base::geometry::{
    Base, Board as BoardFrame, Camera, ColorPicture, GrayPicture, OrganizedCloud, PinholeCamera, Rigid,
};
use panelprep_cell::cell::{BoardSize, MountedPose, TargetMount};
use panelprep_cell::files;
use panelprep_vision::calib::detect::{self, DetectedCorners};
use panelprep_vision::calib::{Board, BoardObservation, CalibError};
use panelprep_vision::locate::ScanErrors;
use std::path::Path;

pub(super) fn parse_board(args: &BoardArgs) -> Result<Board, Fault> {
    Board::parse(&args.board, args.square_mm).map_err(Fault::stage)
}

/// Returns the board that the options state. The command line requires these options, or others that replace them.
pub(super) fn board_from_option(args: &NamedBoard) -> Result<BoardArgs, Fault> {
    let missing = || {
        let message = "is missing: give the inner corners of the board, for example 9x6".to_owned();
        Fault::stage(CalibError::Board { text: String::new(), message })
    };
    args.board().ok_or_else(missing)
}

pub(super) fn window(args: &BoardArgs) -> Option<usize> {
    args.subpix.map(|half_window_px| half_window_px as usize)
}

/// A picture from a file, with its 3D points if the file is a scan.
pub struct BoardImage {
    /// The name of the file in messages.
    pub name: String,
    /// SHA-256 of the file.
    pub hash: String,
    /// The grey levels of the picture.
    pub gray: GrayPicture,
    cloud: Option<OrganizedCloud<Camera>>,
}

impl BoardImage {
    /// Reads a picture or a scan (`.pcd`, `.ply`), and checks that it has the picture size of the camera.
    ///
    /// # Errors
    /// If the file cannot be read, has another size, or is a picture in another format than PNG.
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

    /// Detects the corners of the board.
    ///
    /// # Errors
    /// If the picture shows no board.
    pub fn detect(&self, board: &Board, half_window_px: Option<usize>) -> Result<DetectedCorners, CalibError> {
        detect::detect(&self.name, &self.gray, board, half_window_px)
    }

    /// Reports that the search begins, then detects the corners of the board. The report is needed because the search
    /// in a large picture without a board takes a second.
    ///
    /// # Errors
    /// The errors of [`BoardImage::detect`].
    pub fn detect_and_report(
        &self,
        board: &Board,
        half_window_px: Option<usize>,
        progress: &dyn Fn(&str),
    ) -> Result<DetectedCorners, CalibError> {
        let (columns, rows) = (board.columns(), board.rows());
        progress(&format!("{}: searching for a board with {columns}×{rows} inner corners", self.name));
        self.detect(board, half_window_px)
    }

    /// Returns the corners as the 3D camera measured them, corrected for the camera's own errors; `None` for a picture.
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

    /// Returns the points of the scan; `None` for a picture.
    pub fn cloud(&self) -> Option<&OrganizedCloud<Camera>> {
        self.cloud.as_ref()
    }

    /// Returns the picture in colour, for drawing results on it.
    pub fn color(&self) -> ColorPicture {
        self.gray.to_color()
    }
}

/// A fixed board with which calibrations are verified: the content of a target file.
pub struct Target {
    /// The kind of the board.
    pub board: Board,
    /// The board's pose.
    pub base_from_board: Rigid<Base, BoardFrame>,
}

impl Target {
    /// Reads a target file. If the command line also states a board, the two must be equal.
    ///
    /// # Errors
    /// If the file is invalid, or the command line states another board.
    pub fn read(file: &Path, named: Option<&BoardArgs>) -> Result<Self, Fault> {
        let mounted = MountedPose::<TargetMount>::check(&file.display().to_string(), &disk::read_text(file)?)?;
        let base_from_board = mounted.rigid();
        // The parser has already refused a target file without a board.
        let Some(size) = mounted.board else {
            let missing = CalibError::Points("board and square_mm are missing".to_owned());
            return Err(Fault::file_fault(file, missing));
        };
        let board = Board::parse(&size.board, size.square_mm).map_err(|error| Fault::file_fault(file, error))?;
        // An invalid board on the command line is reported as invalid, instead of as a difference from the target file.
        let requested = named.map(|named| Ok::<_, Fault>((named, parse_board(named)?))).transpose()?;
        if let Some((named, requested)) = requested.filter(|(_, requested)| *requested != board) {
            let stated = BoardSize { board: named.board.clone(), square_mm: requested.square_mm() };
            let message = format!(
                "the target file states {size}, but the command states {stated}; correct --board and --square-mm, \
                 or omit both, or write the target again with --learn"
            );
            return Err(Fault::file_fault(file, CalibError::Points(message)));
        }
        Ok(Target { board, base_from_board })
    }
}
