//! The board to which a file refers: a verification with another board, or one of another size, would find another
//! position.

use panelprep_base::config::Section;

const SQUARE_MM: std::ops::RangeInclusive<f64> = 0.5..=500.0;

/// The board, in the notation of the command line.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSize {
    /// The board's corners or squares, `9x6` or `charuco:8x6:15:4X4_50`.
    pub board: String,
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl std::fmt::Display for BoardSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "--board {} --square-mm {}", self.board, self.square_mm)
    }
}

impl BoardSize {
    pub(super) fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let (board, square_mm) = (section.parse("board", (), None), section.parse("square_mm", SQUARE_MM, None));
        Some(BoardSize { board: board?, square_mm: square_mm? })
    }
}
