//! The calibration board: chessboard, ChArUco or a grid of circles, with its corners (for circles, their centres) as
//! points of frame `Board`.
//!
//! Corner (column, row) is at (column · square, row · square, 0) mm; x is along a row, y down, z away from the viewer.
//! The size of a chessboard is stated in inner corners, that of a ChArUco board in squares, as in OpenCV. A chessboard
//! with one odd and one even side has a unique first corner, next to a black outer square; other chessboards look the
//! same upside down. Circles are arranged in COLUMNS×ROWS. In an asymmetric grid every second row is shifted by the
//! distance between rows, and the circles of a row are twice that distance apart, as OpenCV counts them.

use super::error::CalibError;
use panelprep_base::geometry::{Board as BoardFrame, Pixel, Point};

/// Corners as points on the board, each with its pixel.
pub type Corners = Vec<(Point<BoardFrame>, Pixel)>;

/// The markers of a ChArUco board: their size, dictionary and layout.
#[derive(Debug, Clone, PartialEq)]
pub struct Charuco {
    /// Side of a marker, mm.
    pub marker_mm: f64,
    /// OpenCV's name of the dictionary, `4X4_50`.
    pub dictionary: String,
    /// Whether an OpenCV version before 4.6 printed the board: with an even number of rows, its first square is white
    /// and contains a marker.
    pub legacy: bool,
}

/// The pattern of a board.
#[derive(Debug, Clone, PartialEq)]
enum Pattern {
    Chessboard,
    Charuco(Charuco),
    /// Circles in rows; in an asymmetric grid, every second row is shifted.
    Circles {
        asymmetric: bool,
    },
}

/// A flat calibration board.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    columns: usize,
    rows: usize,
    square_mm: f64,
    pattern: Pattern,
}

const INNER_CORNER_LIMITS: std::ops::RangeInclusive<usize> = 3..=60;

impl Board {
    /// Parses the texts of `--board` and `--square-mm`: `9x6`, `charuco:COLUMNSxROWS:MARKER_MM:DICTIONARY[:legacy]`, or
    /// `circles:COLUMNSxROWS:MM` and `acircles:COLUMNSxROWS:MM`, which need no `--square-mm`.
    ///
    /// # Errors
    /// If the text describes no board, a number is out of range, or a marker is as large as its square.
    pub fn parse(text: &str, square_mm: impl Into<Option<f64>>) -> Result<Self, CalibError> {
        let wrong = |message: String| CalibError::Board { text: text.to_owned(), message };
        let parts: Vec<&str> = text.split(':').collect();
        let named_mm: Option<f64> = square_mm.into();
        let square_mm = match (parts.as_slice(), named_mm) {
            (["circles" | "acircles", _, distance], named_mm) => {
                let circles_mm = distance
                    .parse::<f64>()
                    .map_err(|_| wrong(format!("the distance between circles '{distance}' is not a number")))?;
                if named_mm.is_some_and(|named_mm| named_mm != circles_mm) {
                    return Err(wrong(format!(
                        "the circles are {circles_mm} mm apart, but --square-mm states another distance; omit \
                         --square-mm"
                    )));
                }
                circles_mm
            }
            (_, Some(square_mm)) => square_mm,
            (_, None) => return Err(wrong("--square-mm is missing: state the side of a square in mm".to_owned())),
        };
        if !(0.5..=500.0).contains(&square_mm) {
            return Err(wrong(format!("the side of a square is {square_mm} mm (limits 0.5 to 500 mm)")));
        }
        match parts.as_slice() {
            [kind @ ("circles" | "acircles"), size, _] => {
                let (columns, rows) = sides(size).ok_or_else(|| wrong(shape()))?;
                Self::new(columns, rows, square_mm, Pattern::Circles { asymmetric: *kind == "acircles" })
            }
            ["charuco", size, marker, dictionary] => {
                Self::charuco(sides(size).ok_or_else(|| wrong(shape()))?, square_mm, marker, dictionary, false)
            }
            ["charuco", size, marker, dictionary, "legacy"] => {
                Self::charuco(sides(size).ok_or_else(|| wrong(shape()))?, square_mm, marker, dictionary, true)
            }
            [size] => {
                let (columns, rows) = sides(size).ok_or_else(|| wrong(shape()))?;
                Self::new(columns, rows, square_mm, Pattern::Chessboard)
            }
            _ => Err(shape()),
        }
        .map_err(wrong)
    }

    fn charuco(
        (columns, rows): (usize, usize),
        square_mm: f64,
        marker: &str,
        dictionary: &str,
        legacy: bool,
    ) -> Result<Self, String> {
        let marker_mm: f64 = marker.parse().map_err(|_| format!("the marker's side '{marker}' is not a number"))?;
        if !(0.2 * square_mm..0.95 * square_mm).contains(&marker_mm) {
            return Err(format!(
                "the markers have {marker_mm} mm sides in squares of {square_mm} mm (limits 20 to 95 % of the \
                 square)"
            ));
        }
        let upper = dictionary.to_uppercase();
        let dictionary = upper.strip_prefix("DICT_").unwrap_or(&upper).to_owned();
        let Some(held) = dictionary_marker_count(&dictionary) else {
            return Err(format!(
                "unknown dictionary {dictionary}; valid: OpenCV's 4X4_50 … 7X7_1000 (50, 100, 250, 1000), \
                 ARUCO_ORIGINAL, APRILTAG_16H5, APRILTAG_25H9, APRILTAG_36H10, APRILTAG_36H11"
            ));
        };
        let charuco = Charuco { marker_mm, dictionary: dictionary.clone(), legacy };
        let board =
            Self::new(columns.saturating_sub(1), rows.saturating_sub(1), square_mm, Pattern::Charuco(charuco))?;
        let needed = columns * rows / 2;
        if needed > held {
            return Err(format!(
                "{columns}×{rows} squares need {needed} markers, but {dictionary} has only {held}"
            ));
        }
        Ok(board)
    }

    fn new(columns: usize, rows: usize, square_mm: f64, pattern: Pattern) -> Result<Self, String> {
        if !INNER_CORNER_LIMITS.contains(&columns) || !INNER_CORNER_LIMITS.contains(&rows) {
            return Err(format!("the board has {columns}×{rows} inner corners (limits 3 to 60 in each direction)"));
        }
        Ok(Board { columns, rows, square_mm, pattern })
    }

    /// Returns the number of inner corners in a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the number of rows of inner corners.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the side of a square, or the distance between rows of circles, mm.
    pub fn square_mm(&self) -> f64 {
        self.square_mm
    }

    /// Returns whether this is a chessboard without markers.
    pub fn is_chessboard(&self) -> bool {
        self.markers().is_none() && self.circles().is_none()
    }

    /// Returns the board's markers; `None` for a board without markers.
    pub fn markers(&self) -> Option<&Charuco> {
        match &self.pattern {
            Pattern::Charuco(charuco) => Some(charuco),
            _ => None,
        }
    }

    /// Returns whether every second row of circles is shifted; `None` for a board without circles.
    pub fn circles(&self) -> Option<bool> {
        match self.pattern {
            Pattern::Circles { asymmetric } => Some(asymmetric),
            _ => None,
        }
    }

    /// Returns the number of inner corners.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns whether the board looks different upside down.
    pub fn is_unique(&self) -> bool {
        match self.pattern {
            Pattern::Chessboard => self.columns % 2 != self.rows % 2,
            Pattern::Charuco(_) => true,
            Pattern::Circles { asymmetric } => asymmetric && self.rows % 2 == 1,
        }
    }

    /// Returns the inner corner in this column and row, from 0; `None` if the board has no such corner.
    pub fn corner(&self, column: usize, row: usize) -> Option<Point<BoardFrame>> {
        let across = match self.pattern {
            Pattern::Circles { asymmetric: true } => 2 * column + row % 2,
            _ => column,
        };
        (column < self.columns && row < self.rows)
            .then(|| Point::at(across as f64 * self.square_mm, row as f64 * self.square_mm, 0.0))
    }

    /// Returns all inner corners, row by row.
    pub fn corners(&self) -> Vec<Point<BoardFrame>> {
        (0..self.rows)
            .flat_map(|row| (0..self.columns).filter_map(move |column| self.corner(column, row)))
            .collect()
    }

    /// Returns the centre of the inner corners.
    pub fn centre(&self) -> Point<BoardFrame> {
        let half = |count: usize| (count - 1) as f64 * self.square_mm / 2.0;
        let across = if self.circles() == Some(true) { 2 * self.columns } else { self.columns };
        Point::at(half(across), half(self.rows), 0.0)
    }

    /// Returns the four outer corners, as (column, row), around the board.
    pub fn outer_corners(&self) -> [(usize, usize); 4] {
        let (right, low) = (self.columns - 1, self.rows - 1);
        [(0, 0), (right, 0), (right, low), (0, low)]
    }

    /// Returns the corners to touch in three-point calibration, as (column, row): the origin, the end of the first row,
    /// and the far end of the last row. The fourth corner is a check: it is not an outer corner, so it breaks the
    /// symmetry of the board.
    pub fn corners_to_touch(&self) -> [(usize, usize); 4] {
        let [first, second, third, fourth] = self.outer_corners();
        let wanted = (self.columns / 3, self.rows / 3);
        let away = |(column, row): (usize, usize)| column.abs_diff(wanted.0) + row.abs_diff(wanted.1);
        let breaks = |&corner: &(usize, usize)| !self.is_symmetric(&[first, second, third, corner]);
        let all = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        [first, second, third, all.filter(breaks).min_by_key(|&corner| away(corner)).unwrap_or(fourth)]
    }

    /// Returns whether these corners coincide with each other if the board is rotated or mirrored. In this case, the
    /// distances between them are the same if they are touched from the other end of the board.
    pub fn is_symmetric(&self, corners: &[(usize, usize)]) -> bool {
        let (right, low) = (self.columns - 1, self.rows - 1);
        let mut ways: Vec<fn(usize, usize, usize, usize) -> (usize, usize)> =
            vec![|c, r, right, low| (right - c, low - r), |c, r, right, _| (right - c, r), |c, r, _, low| {
                (c, low - r)
            }];
        if right == low {
            ways.extend([
                (|c, r, _, _| (r, c)) as fn(usize, usize, usize, usize) -> (usize, usize),
                |c, r, right, low| (low - r, right - c),
                |c, r, right, _| (right - r, c),
                |c, r, _, low| (r, low - c),
            ]);
        }
        let on_board = corners.iter().all(|&(column, row)| column <= right && row <= low);
        on_board
            && ways
                .iter()
                .any(|way| corners.iter().all(|&(column, row)| corners.contains(&way(column, row, right, low))))
    }

    /// Returns the ChArUco board with its markers in other layouts, each with a text that states the difference.
    pub(super) fn alternative_layouts(&self) -> Vec<(Board, &'static str)> {
        let Some(charuco) = self.markers() else { return Vec::new() };
        let with = |columns: usize, rows: usize, legacy: bool| Board {
            columns,
            rows,
            pattern: Pattern::Charuco(Charuco { legacy, ..charuco.clone() }),
            ..self.clone()
        };
        let (pattern, other) = match charuco.legacy {
            false => ("in the pattern that OpenCV printed before 4.6 (:legacy)", !charuco.legacy),
            true => ("in the pattern that OpenCV prints since 4.6 (without :legacy)", !charuco.legacy),
        };
        vec![
            (with(self.columns, self.rows, other), pattern),
            (with(self.rows, self.columns, charuco.legacy), "with columns and rows exchanged"),
            (
                with(self.rows, self.columns, other),
                "with columns and rows exchanged, and in the other pattern (:legacy or not)",
            ),
        ]
    }

    /// Returns the board in the form of `--board`.
    pub(super) fn text(&self) -> String {
        let (columns, rows) = (self.columns, self.rows);
        match &self.pattern {
            Pattern::Chessboard => format!("{columns}x{rows}"),
            Pattern::Charuco(Charuco { marker_mm, dictionary, legacy }) => {
                let legacy = if *legacy { ":legacy" } else { "" };
                format!("charuco:{}x{}:{marker_mm}:{dictionary}{legacy}", columns + 1, rows + 1)
            }
            Pattern::Circles { asymmetric } => {
                let kind = if *asymmetric { "acircles" } else { "circles" };
                format!("{kind}:{columns}x{rows}:{}", self.square_mm)
            }
        }
    }

    /// Returns the square (column, row) of each marker, counted from the top left of the board, in the order of the
    /// marker numbers.
    pub fn marker_squares(&self) -> Vec<(usize, usize)> {
        let Some(charuco) = self.markers() else { return Vec::new() };
        let (columns, rows) = (self.columns + 1, self.rows + 1);
        // The legacy pattern counts rows from the bottom.
        let black = |column: usize, row: usize| {
            let row = if charuco.legacy { rows - 1 - row } else { row };
            row % 2 == column % 2
        };
        let squares = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        squares.filter(|&(column, row)| !black(column, row)).collect()
    }
}

/// Returns the number of markers in OpenCV's dictionary of this name.
fn dictionary_marker_count(dictionary: &str) -> Option<usize> {
    match dictionary {
        "ARUCO_ORIGINAL" => Some(1_024),
        "APRILTAG_16H5" => Some(30),
        "APRILTAG_25H9" => Some(35),
        "APRILTAG_36H10" => Some(2_320),
        "APRILTAG_36H11" => Some(587),
        _ => {
            let (family, size) = dictionary.split_once('_')?;
            let known =
                ["4X4", "5X5", "6X6", "7X7"].contains(&family) && ["50", "100", "250", "1000"].contains(&size);
            if known { size.parse().ok() } else { None }
        }
    }
}

fn sides(text: &str) -> Option<(usize, usize)> {
    let (columns, rows) = text.split_once('x')?;
    Some((columns.parse().ok()?, rows.parse().ok()?))
}

fn shape() -> String {
    "valid: a chessboard by its inner corners, such as 9x6; charuco:COLUMNSxROWS:MARKER_MM:DICTIONARY[:legacy] by \
     its squares, such as charuco:8x6:15:4X4_50; circles by COLUMNSxROWS and their distance in mm, such as \
     circles:7x11:40 or acircles:4x11:20"
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_a_chessboard_is_its_inner_corners() {
        let board = Board::parse("9x6", 25.0).expect("a board");
        assert_eq!((board.columns(), board.rows(), board.count()), (9, 6, 54));
        assert_eq!(board.corner(8, 5), Some(Point::at(200.0, 125.0, 0.0)));
        assert_eq!(board.corner(9, 0), None);
        assert_eq!(board.centre(), Point::at(100.0, 62.5, 0.0));
        assert!(board.is_unique() && !Board::parse("8x6", 25.0).expect("a board").is_unique());
    }

    /// Expected result for 4×4 squares: the current pattern begins with a black square, the legacy pattern with a white
    /// square that contains marker 0.
    #[test]
    fn legacy_charuco_with_even_rows_begins_white() {
        let squares = |text: &str| Board::parse(text, 20.0).expect("a board").marker_squares();
        assert_eq!(squares("charuco:4x4:15:4X4_50")[..3], [(1, 0), (3, 0), (0, 1)]);
        assert_eq!(squares("charuco:4x4:15:4x4_50:legacy")[..3], [(0, 0), (2, 0), (1, 1)]);
        let odd = ["charuco:4x5:15:4X4_50", "charuco:4x5:15:4X4_50:legacy"].map(squares);
        assert_eq!(odd[0], odd[1], "an odd number of rows has one pattern");
    }

    /// Expected result: the second row of an asymmetric grid begins one distance to the right, and the circles of a row
    /// are two distances apart.
    #[test]
    fn circles_state_their_distance() {
        let board = Board::parse("circles:7x11:40", None).expect("a board");
        assert_eq!((board.corner(6, 10), board.is_unique()), (Some(Point::at(240.0, 400.0, 0.0)), false));
        let board = Board::parse("acircles:4x11:20", 20.0).expect("a board");
        assert_eq!(
            (board.corner(3, 1), board.corner(0, 2)),
            (Some(Point::at(140.0, 20.0, 0.0)), board.corner(0, 2))
        );
        assert_eq!((board.centre(), board.is_unique()), (Point::at(70.0, 100.0, 0.0), true));
        let error = Board::parse("circles:7x11:40", 25.0).expect_err("two distances").to_string();
        assert!(error.contains("omit --square-mm"), "{error}");
        let error = Board::parse("9x6", None).expect_err("no side").to_string();
        assert!(error.contains("--square-mm is missing"), "{error}");
    }

    /// Expected result for 9×6 corners: the outer corners form a rectangle, which looks the same mirrored; the corner
    /// in column 3, row 2 breaks the symmetry.
    #[test]
    fn the_fourth_corner_breaks_the_symmetry() {
        let board = Board::parse("9x6", 25.0).expect("a board");
        assert!(board.is_symmetric(&board.outer_corners()));
        assert_eq!(board.corners_to_touch(), [(0, 0), (8, 0), (8, 5), (3, 2)]);
        assert!(!board.is_symmetric(&board.corners_to_touch()));
        let square = Board::parse("7x7", 20.0).expect("a board");
        assert!(!square.is_symmetric(&square.corners_to_touch()));
    }

    /// The names of the dictionaries are those of OpenCV, including AprilTags. An unknown name is refused once, before
    /// any picture is examined.
    #[test]
    fn dictionaries_are_named_as_opencv_names_them() {
        let name = |text: &str| {
            let board = Board::parse(&format!("charuco:8x6:15:{text}"), 20.0)?;
            Ok::<_, CalibError>(board.markers().map(|charuco| charuco.dictionary.clone()))
        };
        for (text, expected) in [
            ("4X4_50", "4X4_50"),
            ("DICT_4X4_50", "4X4_50"),
            ("dict_5x5_1000", "5X5_1000"),
            ("DICT_APRILTAG_36h11", "APRILTAG_36H11"),
            ("ARUCO_ORIGINAL", "ARUCO_ORIGINAL"),
        ] {
            assert_eq!(name(text), Ok(Some(expected.to_owned())));
        }
        let error = name("4X4_51").expect_err("no dictionary").to_string();
        assert!(error.contains("4X4_51") && error.contains("APRILTAG_36H11"), "{error}");
        let error = name("APRILTAG_16h5:legacy").map(|_| ()).map_err(|error| error.to_string());
        assert_eq!(error, Ok(()), "24 markers of 30");
        let error = Board::parse("charuco:12x9:15:APRILTAG_16h5", 20.0).expect_err("54 of 30").to_string();
        assert!(error.contains("54 markers") && error.contains("30"), "{error}");
    }

    #[test]
    fn texts_without_a_board_are_refused_with_the_reason() {
        for (text, square_mm, words) in [
            ("9 x 6", 25.0, "valid: a chessboard"),
            ("9x2", 25.0, "9×2 inner corners"),
            ("9x6", f64::NAN, "the side of a square is NaN mm"),
            ("charuco:8x6:25:4X4_50", 25.0, "20 to 95 %"),
            ("charuco:8x6:ten:4X4_50", 25.0, "is not a number"),
        ] {
            let error = Board::parse(text, square_mm).expect_err(text).to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
