//! Assigns the corners of a lattice to those of a ChArUco board by the cells of its markers; no marker needs to be
//! readable.
//!
//! The squares of a ChArUco board meet in corners as those of a chessboard do. `chessboard` joins them to a lattice
//! even if blur, noise or a glare hides the markers' codes. The lattice can lie on the board in four rotations and
//! at several positions. For each of these the grey levels at the centres of all cells are compared with the print,
//! square by square. One assignment must be clearly the best.

use super::board::Board;
use super::chessboard::Grid;
use super::crossings::SmoothedPicture;
use super::foreign;
use nalgebra::{Matrix3, Vector2, Vector3};
use panelprep_base::geometry::Pixel;

/// Minimum correlation of the grey levels with the print, over all squares with markers. It must exceed the
/// second-best one by at least `ABOVE`.
pub(super) const MIN_PRINT_CORRELATION: f64 = 0.4;
const ABOVE: f64 = 0.15;
/// Minimum number of squares with markers that are compared.
const MIN_SQUARES: usize = 4;

/// Corners by column and row of the board.
pub(super) type LatticeCorners = Vec<((i32, i32), Pixel)>;

/// The cells of each marker of a board, with the column and row of its square.
pub(super) type Cells = Vec<((usize, usize), Vec<bool>)>;

/// Assigns the seen corners of a lattice to those of the board; `None` if no position is clearly the right one.
pub(super) fn assign_lattice(
    smooth: &SmoothedPicture,
    grid: &Grid,
    board: &Board,
    cells: &Cells,
) -> Option<LatticeCorners> {
    let share = board.markers()?.marker_mm / board.square_mm();
    let mut seen: LatticeCorners = Vec::new();
    for (index, node) in grid.nodes.iter().enumerate().filter(|(_, node)| node.is_seen) {
        seen.push((((index % grid.columns) as i32, (index / grid.columns) as i32), node.pixel));
    }
    // A woven texture has more corners than a board, and would be compared at thousands of positions.
    if 3 * seen.len() > 4 * board.count() {
        return None;
    }
    let (mut wide, mut high) = (grid.columns as i32, grid.rows as i32);
    if is_mirrored(grid) {
        seen.iter_mut().for_each(|((column, _), _)| *column = wide - 1 - *column);
    }
    let (columns, rows) = (board.columns() as i32, board.rows() as i32);
    let mut scores: Vec<(f64, LatticeCorners)> = Vec::new();
    for _ in 0..4 {
        for right in (-1).min(columns - wide)..=(columns - wide + 1).max(0) {
            for down in (-1).min(rows - high)..=(rows - high + 1).max(0) {
                let moved = seen.iter().map(|((c, r), pixel)| ((c + right, r + down), *pixel));
                let inside: LatticeCorners =
                    moved.filter(|((c, r), _)| (0..columns).contains(c) && (0..rows).contains(r)).collect();
                if 4 * inside.len() >= 3 * seen.len()
                    && let Some(score) = print_correlation(smooth, &inside, cells, share)
                {
                    scores.push((score, inside));
                }
            }
        }
        // Rotates by a quarter turn: (column, row) becomes (row, −column).
        seen.iter_mut().for_each(|(at, _)| *at = (at.1, wide - 1 - at.0));
        (wide, high) = (high, wide);
    }
    scores.sort_by(|a, b| b.0.total_cmp(&a.0));
    let second = scores.get(1).map_or(0.0, |(score, _)| *score);
    let (best, corners) = scores.into_iter().next()?;
    (best > MIN_PRINT_CORRELATION && best > second + ABOVE).then_some(corners)
}

fn is_mirrored(grid: &Grid) -> bool {
    let [first, right, below] =
        [0, grid.columns - 1, (grid.rows - 1) * grid.columns].map(|index| grid.nodes[index].pixel);
    (right.u - first.u) * (below.v - first.v) < (right.v - first.v) * (below.u - first.u)
}

/// Returns the mean correlation of the grey levels with the print, over the squares beside the corners.
fn print_correlation(smooth: &SmoothedPicture, corners: &LatticeCorners, cells: &Cells, share: f64) -> Option<f64> {
    let places: Vec<[f64; 2]> = corners.iter().map(|((c, r), _)| [f64::from(*c), f64::from(*r)]).collect();
    let pixels: Vec<Pixel> = corners.iter().map(|(_, pixel)| *pixel).collect();
    let plane = if places.len() >= 4 { foreign::homography(&places, &pixels)? } else { return None };
    let is_beside = |(column, row): (usize, usize)| {
        // The square (c, r) lies between the corners (c − 1, r − 1) and (c, r).
        let (column, row) = (column as i32, row as i32);
        let near = |(c, r): (i32, i32)| (column - 1..=column).contains(&c) && (row - 1..=row).contains(&r);
        corners.iter().filter(|(at, _)| near(*at)).count() >= 2
    };
    let squares = cells.iter().filter(|(square, _)| is_beside(*square));
    let all: Vec<f64> =
        squares.map(|(square, cells)| correlation(smooth, &plane, *square, (cells, share, 0))).collect();
    (all.len() >= MIN_SQUARES).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Returns the correlation of the grey levels with a square's print, without `rim` cells at its border: the outermost
/// cells are black in every marker.
pub(super) fn correlation(
    smooth: &SmoothedPicture,
    plane: &Matrix3<f64>,
    square: (usize, usize),
    (cells, share, rim): (&[bool], f64, usize),
) -> f64 {
    let side = (cells.len() as f64).sqrt() as usize;
    let at = |index: usize, square: usize| {
        square as f64 - 1.0 + (1.0 - share) / 2.0 + share * (index as f64 + 0.5) / side as f64
    };
    let is_inner = |index: usize| (rim..side - rim).contains(&index);
    let pairs: Vec<(f64, f64)> = (cells.iter().enumerate())
        .filter(|(index, _)| is_inner(index % side) && is_inner(index / side))
        .map(|(index, is_white)| {
            let p = plane * Vector3::new(at(index % side, square.0), at(index / side, square.1), 1.0);
            (smooth.interpolate(Vector2::new(p.x / p.z, p.y / p.z)), f64::from(u8::from(*is_white)))
        })
        .collect();
    let count = pairs.len() as f64;
    let (gray, ink) = pairs.iter().fold((0.0, 0.0), |(g, i), pair| (g + pair.0 / count, i + pair.1 / count));
    let sum = |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|(g, i)| of(g - gray, i - ink)).sum::<f64>();
    sum(&|g, i| g * i) / (sum(&|g, _| g * g) * sum(&|_, i| i * i)).sqrt().max(1e-9)
}
