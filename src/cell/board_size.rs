//! Which board a file speaks of: a look through another board, or one of another size, would put it elsewhere.

use crate::config::Section;

const SQUARE_MM: std::ops::RangeInclusive<f64> = 0.5..=500.0;

/// Which board it is, as the command line names it.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSize {
    /// Its corners or squares, `9x6` or `charuco:8x6:15:4X4_50`.
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
