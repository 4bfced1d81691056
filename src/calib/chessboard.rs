//! Where a picture shows a chessboard, to about a pixel, by work that does not depend on what the picture holds.
//!
//! `findChessboardCornersSB` looks at the picture several times, at a small size first: a large board is found there, and
//! the last look sees at most [`MOST_PX`] pixels. (`findChessboardCorners` combines contours, and a picture with fine
//! texture, or another board, can occupy it for minutes.) Each look asks for the board or a larger one, because a search
//! for exactly so many corners takes a part of a larger board for the whole. What it finds may have grown beyond its board,
//! since the outer squares' corners look a little like inner ones: only a grid in whose outer lines squares truly meet
//! counts. Where none is found, one more look says which other board is there.

use super::board::Board;
use super::foreign::{self, CornerGrid, Extent};
use super::placing;
use crate::geometry::{GrayPicture, Pixel};
use crate::imaging::ImagingError;

/// A larger picture is searched at half its size, or less.
const MOST_PX: usize = 3_400_000;
/// Another board is looked for in at most so many pixels.
const OTHER_PX: usize = 850_000;
/// A picture is not reduced below this length of its longer side, px.
const LEAST_SIDE_PX: usize = 480;
/// The smallest chessboard that is called one, inner corners.
const SMALLEST: usize = 3;
/// Of each outer line of a grid so many corners must be corners of squares.
const REAL_SHARE: f64 = 0.5;

/// What a picture shows.
#[derive(Debug, PartialEq)]
pub(super) enum Search {
    /// The board: its corners row by row.
    Board(Vec<Pixel>),
    /// Another one, by its inner corners, the longer side first.
    Other([usize; 2]),
    /// None.
    Nothing,
}

/// Looks for a board.
pub(super) fn find(picture: &GrayPicture, board: &Board) -> Result<Search, ImagingError> {
    let (columns, rows) = (board.columns(), board.rows());
    let all = reductions(picture);
    for &times in &all {
        let Some(grid) = look(picture, times, (columns, rows), Extent::OrLarger)? else { continue };
        if is_real(picture, &grid)? {
            return Ok(match grid.turned_to(columns, rows) {
                Some(grid) => Search::Board(oriented(grid, picture, board)),
                None => Search::Other(grid.sides()),
            });
        }
        let exact = look(picture, times, (columns, rows), Extent::Exact)?;
        match exact.and_then(|grid| grid.turned_to(columns, rows)) {
            Some(grid) if is_real(picture, &grid)? => {
                return Ok(Search::Board(oriented(grid, picture, board)));
            }
            _ => {}
        }
    }
    let small = |times: &&usize| picture.gray.len() / (*times * *times) <= OTHER_PX;
    let times = all.iter().rev().find(small).or(all.first()).copied().unwrap_or(1);
    let other = look(picture, times, (SMALLEST, SMALLEST), Extent::OrLarger)?;
    match other.filter(|grid| grid.turned_to(columns, rows).is_none()) {
        Some(grid) if is_real(picture, &grid)? => Ok(Search::Other(grid.sides())),
        _ => Ok(Search::Nothing),
    }
}

/// By how much the picture is made smaller for each look, the smallest picture first.
pub(super) fn reductions(picture: &GrayPicture) -> Vec<usize> {
    let long = picture.width.max(picture.height);
    let times = (0..16).map(|power| 1usize << power);
    let mut all: Vec<usize> = times
        .take_while(|times| *times == 1 || long / times >= LEAST_SIDE_PX)
        .filter(|times| picture.gray.len() / (times * times) <= MOST_PX)
        .collect();
    all.reverse();
    all
}

/// A grid of so many corners, in pixels of the whole picture.
fn look(
    picture: &GrayPicture,
    times: usize,
    (columns, rows): (usize, usize),
    extent: Extent,
) -> Result<Option<CornerGrid>, ImagingError> {
    if times == 1 {
        return foreign::chessboard(picture, (columns, rows), extent);
    }
    let small = foreign::reduced(picture, times)?;
    let across = picture.width as f64 / small.width as f64;
    let down = picture.height as f64 / small.height as f64;
    let whole = |pixel: &Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
    let grid = foreign::chessboard(&small, (columns, rows), extent)?;
    Ok(grid.map(|grid| CornerGrid { pixels: grid.pixels.iter().map(whole).collect(), ..grid }))
}

/// Do squares meet in the corners of each of the four outer lines? A grid may have grown beyond its board, and texture
/// has places that look like corners from afar.
fn is_real(picture: &GrayPicture, grid: &CornerGrid) -> Result<bool, ImagingError> {
    // Of the board only the counts matter here.
    let Ok(board) = Board::parse(&format!("{}x{}", grid.columns, grid.rows), 1.0) else { return Ok(false) };
    let placed = placing::refined(picture, &board, &grid.pixels, None)?;
    let fits: Vec<bool> = placing::models(picture, &board, &placed).iter().map(Option::is_some).collect();
    let row = |row: usize| (0..grid.columns).map(move |column| row * grid.columns + column).collect::<Vec<_>>();
    let column = |column: usize| (0..grid.rows).map(|row| row * grid.columns + column).collect::<Vec<_>>();
    let lines = [row(0), row(grid.rows - 1), column(0), column(grid.columns - 1)];
    let share = |line: &Vec<usize>| line.iter().filter(|index| fits[**index]).count() as f64 / line.len() as f64;
    Ok(lines.iter().all(|line| share(line) >= REAL_SHARE))
}

impl CornerGrid {
    /// Inner corners of both sides, the longer first.
    fn sides(&self) -> [usize; 2] {
        [self.columns.max(self.rows), self.columns.min(self.rows)]
    }

    /// The same corners with so many columns and rows; `None` where it has others.
    fn turned_to(&self, columns: usize, rows: usize) -> Option<CornerGrid> {
        if (self.columns, self.rows) == (columns, rows) {
            return Some(self.clone());
        }
        let at = |row: usize, column: usize| self.pixels[column * self.columns + row];
        let across = || (0..rows).flat_map(|row| (0..columns).map(move |column| at(row, column))).collect();
        ((self.rows, self.columns) == (columns, rows)).then(|| CornerGrid { columns, rows, pixels: across() })
    }
}

/// The corners in the board's own order: never mirrored; a board with a unique first corner begins where the outer square
/// is black, a square one in the upper left, another one with its upper end.
fn oriented(grid: CornerGrid, picture: &GrayPicture, board: &Board) -> Vec<Pixel> {
    let (columns, rows, mut corners) = (grid.columns, grid.rows, grid.pixels);
    let (first, right, below) = (corners[0], corners[columns - 1], corners[(rows - 1) * columns]);
    let turn = (right.u - first.u) * (below.v - first.v) - (right.v - first.v) * (below.u - first.u);
    if turn < 0.0 {
        corners.chunks_mut(columns).for_each(<[Pixel]>::reverse);
    }
    if columns == rows {
        return upper_left_first(corners, columns);
    }
    if is_upside_down(&corners, picture, board) {
        corners.reverse();
    }
    corners
}

/// Of the four turns of a square grid the one whose first corner is nearest the picture's upper left.
fn upper_left_first(corners: Vec<Pixel>, side: usize) -> Vec<Pixel> {
    let turned = |corners: &Vec<Pixel>| -> Vec<Pixel> {
        let at = |index: usize| corners[(side - 1 - index % side) * side + index / side];
        (0..side * side).map(at).collect()
    };
    let mut all = vec![corners];
    (0..3).for_each(|turn| all.push(turned(&all[turn])));
    let away = |corners: &Vec<Pixel>| corners[0].u + corners[0].v;
    all.into_iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or_default()
}

/// Is the outer square at the first corner white, or, where that decides nothing, the first corner below the last?
fn is_upside_down(corners: &[Pixel], picture: &GrayPicture, board: &Board) -> bool {
    let last = corners.len() - 1;
    if !board.is_unique() {
        return corners[last].v < corners[0].v;
    }
    let columns = board.columns();
    let outer = |corner: usize, right: usize, below: usize| {
        let (c, r, b) = (corners[corner], corners[right], corners[below]);
        gray_at(picture, Pixel::at(c.u - (r.u - c.u + b.u - c.u) / 2.0, c.v - (r.v - c.v + b.v - c.v) / 2.0))
    };
    let first = outer(0, 1, columns);
    let far = outer(last, last - 1, last - columns);
    matches!((first, far), (Some(first), Some(far)) if first > far)
}

/// Mean of the nine pixels around a place.
fn gray_at(picture: &GrayPicture, at: Pixel) -> Option<f64> {
    let (column, row) = at.whole(picture.width, picture.height)?;
    let columns = column.saturating_sub(1)..(column + 2).min(picture.width);
    let rows = row.saturating_sub(1)..(row + 2).min(picture.height);
    let pixels = rows.flat_map(|row| columns.clone().map(move |column| row * picture.width + column));
    let (sum, count) = pixels.fold((0.0, 0.0), |(sum, n), i| (sum + f64::from(picture.gray[i]), n + 1.0));
    Some(sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 2592 px halve to 1296 and 648 px; 5.0 megapixels are more than one look may see. A small picture is
    /// looked at as it is.
    #[test]
    fn the_last_look_is_bounded_and_the_first_one_is_small() {
        let all = |width: usize, height: usize| reductions(&GrayPicture::filled(width, height, 0));
        assert_eq!(all(1944, 1200), [4, 2, 1]);
        assert_eq!(all(2592, 1944), [4, 2]);
        assert_eq!(all(640, 480), [1]);
        assert_eq!(all(300, 200), [1]);
    }

    /// By hand, a grid of 2 columns and 3 rows, seen mirrored, transposed and upside down: pixel (u, v) of its corner in
    /// column c and row r is (c, r).
    #[test]
    fn any_order_of_the_corners_becomes_the_board_s() {
        let pixel = |(u, v): (usize, usize)| Pixel::at(u as f64, v as f64);
        let grid = |columns: usize, rows: usize, corners: &[(usize, usize)]| CornerGrid {
            columns,
            rows,
            pixels: corners.iter().copied().map(pixel).collect(),
        };
        let right: Vec<Pixel> = (0..12).map(|i| pixel((i % 4, i / 4))).collect();
        let turned = grid(3, 4, &[0, 1, 2, 3].map(|u| [0, 1, 2].map(|v| (u, v))).concat());
        assert_eq!(turned.turned_to(4, 3).map(|grid| grid.pixels), Some(right.clone()));
        assert_eq!(turned.turned_to(5, 3), None);
        let picture = GrayPicture::filled(8, 8, 0);
        // Both sides even: the upper end comes first, whichever way the corners were found.
        let board = Board::parse("6x4", 1.0).expect("a board");
        let upright: Vec<(usize, usize)> = (0..24).map(|i| (i % 6, i / 6)).collect();
        let expected: Vec<Pixel> = upright.iter().copied().map(pixel).collect();
        let mirrored: Vec<_> = upright.iter().map(|&(u, v)| (5 - u, v)).collect();
        let upside: Vec<_> = upright.iter().rev().copied().collect();
        for found in [upright.clone(), mirrored, upside] {
            assert_eq!(oriented(grid(6, 4, &found), &picture, &board), expected, "{found:?}");
        }
        let square: Vec<(usize, usize)> = (0..9).map(|i| (2 - i / 3, i % 3)).collect();
        let expected: Vec<Pixel> = (0..9).map(|i| pixel((i % 3, i / 3))).collect();
        let board = Board::parse("3x3", 1.0).expect("a board");
        assert_eq!(oriented(grid(3, 3, &square), &picture, &board), expected);
    }
}
