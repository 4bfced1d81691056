//! ChArUco: markers say which corners are seen, also where a part of the board is covered.
//!
//! The markers are found by OpenCV's aruco. Each inner corner lies between two of them; the homography through their
//! eight corners foretells it, and `cornerSubPix` and `saddle` refine it with a window that ends before the markers do. The layout
//! is our own, so that boards printed by OpenCV before 4.6 (`legacy`) and since are both read by any version.

use super::board::{Board, Charuco};
use super::chessboard;
use super::error::CalibError;
use super::foreign;
use super::placing::{Detected, modelled};
use crate::geometry::{GrayPicture, Pixel};
use crate::imaging::ImagingError;
use std::collections::BTreeMap;

/// Fewer corners than this place no board well.
const MIN_CORNERS: usize = 8;
/// How far a marker's corner may lie from the common plane, as a share of its side: a lens bends far less.
const BENT: f64 = 0.15;

pub(super) fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    charuco: &Charuco,
    half_window_px: Option<usize>,
) -> Result<Detected, CalibError> {
    let unknown = || CalibError::Board {
        text: charuco.dictionary.clone(),
        message: "allowed are OpenCV's dictionaries 4X4_50 … 7X7_1000 and ARUCO_ORIGINAL".to_owned(),
    };
    let dictionary = foreign::dictionary_number(&charuco.dictionary).ok_or_else(unknown)?;
    let squares = board.marker_squares();
    let markers = markers(picture, dictionary, squares.len())?;
    let seen = |column: usize, row: usize| {
        let number = squares.iter().position(|square| *square == (column, row))?;
        markers.get(&number).map(|corners| ((column, row), *corners))
    };
    let mut corners = Vec::new();
    for row in 0..board.rows() {
        for column in 0..board.columns() {
            let around = [(column, row), (column + 1, row), (column, row + 1), (column + 1, row + 1)];
            let near: Vec<_> = around.into_iter().filter_map(|(column, row)| seen(column, row)).collect();
            let (Some(q), true) = (board.corner(column, row), near.len() == 2) else { continue };
            corners.extend(foretold(board, charuco, &near, [q.mm.x, q.mm.y]).map(|corner| (q, corner)));
        }
    }
    if corners.len() < MIN_CORNERS {
        return Err(CalibError::NoBoard { picture: name.to_owned(), columns: board.columns(), rows: board.rows() });
    }
    let reach_px = corners.iter().map(|(_, (_, reach_px))| *reach_px).fold(f64::INFINITY, f64::min);
    let chosen_px = half_window_px.unwrap_or(reach_px.clamp(3.0, 11.0) as usize);
    let rough: Vec<Pixel> = corners.iter().map(|(_, (pixel, _))| *pixel).collect();
    let refined = foreign::refine_corners(picture, &rough, chosen_px)?;
    let corners = corners.iter().map(|(q, _)| *q).zip(refined).collect();
    let found = Detected { corners, half_window_px: chosen_px, modelled: 0 };
    Ok(if half_window_px.is_none() { modelled(picture, board, found) } else { found })
}

/// The markers with their numbers, from looks at growing sizes: a large board is found whole in a small picture, and the
/// last look is bounded like that for a chessboard. The corners are those of the largest look that saw the marker.
fn markers(
    picture: &GrayPicture,
    dictionary: i32,
    count: usize,
) -> Result<BTreeMap<usize, [Pixel; 4]>, ImagingError> {
    let mut all = BTreeMap::new();
    for times in chessboard::reductions(picture) {
        let small = if times == 1 { None } else { Some(foreign::reduced(picture, times)?) };
        let small = small.as_ref().unwrap_or(picture);
        let across = picture.width as f64 / small.width as f64;
        let down = picture.height as f64 / small.height as f64;
        let whole = |pixel: Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
        let found = foreign::markers(small, dictionary)?;
        all.extend(
            found.into_iter().filter(|(number, _)| *number < count).map(|(n, corners)| (n, corners.map(whole))),
        );
        if all.len() == count {
            break;
        }
    }
    Ok(all)
}

type Near = ((usize, usize), [Pixel; 4]);

/// Where a corner of the board is, from the two markers beside it, and how far it is to the nearest of them, px.
fn foretold(board: &Board, charuco: &Charuco, near: &[Near], at: [f64; 2]) -> Option<(Pixel, f64)> {
    let (square, inset) = (board.square_mm(), (board.square_mm() - charuco.marker_mm) / 2.0);
    let (mut places, mut pixels) = (Vec::new(), Vec::new());
    for ((column, row), corners) in near {
        let low = [*column as f64 - 1.0, *row as f64 - 1.0].map(|index| index * square + inset);
        let side = charuco.marker_mm;
        for ([x, y], pixel) in [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].iter().zip(corners) {
            places.push([low[0] + x - at[0], low[1] + y - at[1]]);
            pixels.push(*pixel);
        }
    }
    let plane = foreign::homography(&places, &pixels)?;
    let pixel_of = |x: f64, y: f64| {
        let p = plane * nalgebra::Vector3::new(x, y, 1.0);
        Pixel::at(p.x / p.z, p.y / p.z)
    };
    let corner = pixel_of(0.0, 0.0);
    let nearest = pixels.iter().map(|pixel| pixel.distance_px(corner)).fold(f64::INFINITY, f64::min);
    // Two markers of another layout, or of another board, do not lie on one plane together.
    let side_px = pixels[0].distance_px(pixels[1]);
    let apart = |([x, y], pixel): (&[f64; 2], &Pixel)| pixel_of(*x, *y).distance_px(*pixel);
    if places.iter().zip(&pixels).map(apart).any(|apart| apart > BENT * side_px) {
        return None;
    }
    // The marker's corner is √2 insets away, the window's side only one: 0.6 of the way is clear of it.
    Some((corner, 0.6 * nearest))
}

/// The cells of a board's markers with their rims, in the order of [`Board::marker_squares`]: for printing it.
///
/// # Errors
/// Where the dictionary is unknown or holds too few markers.
pub fn marker_cells(board: &Board) -> Result<Vec<Vec<bool>>, CalibError> {
    let Some(charuco) = board.markers() else { return Ok(Vec::new()) };
    let unknown = || CalibError::Board {
        text: charuco.dictionary.clone(),
        message: "allowed are OpenCV's dictionaries 4X4_50 … 7X7_1000 and ARUCO_ORIGINAL".to_owned(),
    };
    let dictionary = foreign::dictionary_number(&charuco.dictionary).ok_or_else(unknown)?;
    let cells = (0..board.marker_squares().len()).map(|number| foreign::marker_cells(dictionary, number));
    Ok(cells.collect::<Result<_, _>>()?)
}
