//! Boards: the board that the arguments name, a fixed board with its known pose and kind from its file, and a file that
//! shows a board, which is a picture or a 3D shot with the points of its pixels.

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

/// Returns the board that the options name. The command line itself requires either these options or one that replaces
/// them.
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

/// A picture from a file, and its 3D points if the file has them.
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

    /// Reports that the search begins, then finds the board's corners: in a large picture without the board, the search
    /// takes a second.
    ///
    /// # Errors
    /// As [`BoardImage::detect`].
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

/// A board with which calibrations are verified.
pub struct Target {
    /// Description of the board.
    pub board: Board,
    /// The board's pose.
    pub base_from_board: Rigid<Base, BoardFrame>,
}

impl Target {
    /// Reads the file of a target; a board that the command also names must be the same.
    ///
    /// # Errors
    /// If the file is invalid, or the command names another board.
    pub fn read(file: &Path, named: Option<&BoardArgs>) -> Result<Self, Fault> {
        let mounted = MountedPose::<TargetMount>::check(&file.display().to_string(), &disk::read_text(file)?)?;
        let base_from_board = mounted.rigid();
        // The check of the file accepts no target without a board.
        let Some(size) = mounted.board else {
            let missing = CalibError::Points("board and square_mm are missing".to_owned());
            return Err(Fault::file_fault(file, missing));
        };
        let board = Board::parse(&size.board, size.square_mm).map_err(|error| Fault::file_fault(file, error))?;
        // A named board that is invalid is refused as invalid, not as a board that differs from the target's.
        let requested = named.map(|named| Ok::<_, Fault>((named, parse_board(named)?))).transpose()?;
        if let Some((named, requested)) = requested.filter(|(_, requested)| *requested != board) {
            let stated = BoardSize { board: named.board.clone(), square_mm: requested.square_mm() };
            let message = format!(
                "the target file states {size}, but the command states {stated}; correct --board and --square-mm, \
                 or leave both out, or write the target again with --learn"
            );
            return Err(Fault::file_fault(file, CalibError::Points(message)));
        }
        Ok(Target { board, base_from_board })
    }
}
