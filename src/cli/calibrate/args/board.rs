//! Command line arguments that name the board.

use clap::Args;

/// The board.
#[derive(Debug, Clone, Args)]
pub struct BoardArgs {
    /// Inner corners of a chessboard, 9x6; squares of a ChArUco board, charuco:8x6:15:4X4_50[:legacy]; circles,
    /// circles:7x11:40 (7 in each of 11 rows, 40 mm apart in both directions), acircles:4x11:20 (4 in each of 11 rows, rows 20 mm
    /// apart, circles of a row 40 mm, each second row shifted by 20 mm).
    #[arg(long)]
    pub board: String,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM")]
    pub square_mm: Option<f64>,
    /// Half the side of the window that refines a corner, px; if not given, calculated from the distance of corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

/// The board, if a file also states it.
#[derive(Debug, Clone, Default, Args)]
pub struct NamedBoard {
    /// Inner corners of a chessboard, 9x6; squares of a ChArUco board, charuco:8x6:15:4X4_50[:legacy]; circles,
    /// circles:7x11:40 or acircles:4x11:20.
    #[arg(long)]
    pub board: Option<String>,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM", requires = "board")]
    pub square_mm: Option<f64>,
    /// Half the side of the window that refines a corner, px; if it is not given, it is calculated from the distance
    /// between corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

impl NamedBoard {
    /// The board that the command names; `None` if it names none.
    pub fn board(&self) -> Option<BoardArgs> {
        Some(BoardArgs { board: self.board.clone()?, square_mm: self.square_mm, subpix: self.subpix })
    }
}

impl From<BoardArgs> for NamedBoard {
    fn from(BoardArgs { board, square_mm, subpix }: BoardArgs) -> Self {
        NamedBoard { board: Some(board), square_mm, subpix }
    }
}
