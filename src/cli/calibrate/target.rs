//! A fixed board: its known pose and its kind, from its file.

use super::super::disk;
use super::super::fault::Fault;
use super::args::BoardArgs;
use super::boards;
use panelprep_base::geometry::{Base, Board as BoardFrame, Rigid};
use panelprep_cell::cell::{BoardSize, MountedPose, TargetMount};
use panelprep_vision::calib::{Board, CalibError};
use std::path::Path;

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
        let requested = named.map(|named| Ok::<_, Fault>((named, boards::board(named)?))).transpose()?;
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
