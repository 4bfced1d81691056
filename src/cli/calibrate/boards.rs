//! The board that the arguments name.

use super::super::fault::Fault;
use super::args::BoardArgs;
use crate::calib::Board;

pub(super) fn board(args: &BoardArgs) -> Result<Board, Fault> {
    Board::parse(&args.board, args.square_mm).map_err(Fault::stage)
}

pub(super) fn window(args: &BoardArgs) -> Option<usize> {
    args.subpix.map(|half_window_px| half_window_px as usize)
}
