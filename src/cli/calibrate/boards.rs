//! Reads the board that the arguments name.

use super::super::fault::Fault;
use super::args::{BoardArgs, NamedBoard};
use panelprep_vision::calib::{Board, CalibError};

pub(super) fn board(args: &BoardArgs) -> Result<Board, Fault> {
    Board::parse(&args.board, args.square_mm).map_err(Fault::stage)
}

/// Returns the board of an option that another option may replace; the command line itself requires one of both.
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
