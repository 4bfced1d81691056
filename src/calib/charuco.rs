//! ChArUco: markers say which corners are seen, also where a part of the board is covered.
//!
//! The markers are found by OpenCV's aruco. The homography through the markers around an inner corner foretells it, and
//! `cornerSubPix` and `saddle` refine it with a window that ends before the markers do; a corner that is not between two markers
//! which were seen counts where the model of `saddle` fits. The layout is our own, so that boards printed by OpenCV before 4.6 (`legacy`) and since are both read by any version.

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
/// … of all markers together, which a lens bends more.
const BENT_WHOLE: f64 = 0.6;
/// Markers within so many squares of a corner tell where it is.
const NEAR_SQUARES: f64 = 2.2;

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
    let found = markers(picture, dictionary, squares.len())?;
    let seen =
        of_one_plane(found.iter().map(|(number, corners)| (squares[*number], *corners)).collect(), board, charuco);
    let (mut corners, mut is_seen) = (Vec::new(), Vec::new());
    for row in 0..board.rows() {
        for column in 0..board.columns() {
            let Some(q) = board.corner(column, row) else { continue };
            // A marker's square is as far from the corner as its middle is, in squares.
            let away = |(c, r): (usize, usize)| (c as f64 - column as f64 - 0.5).hypot(r as f64 - row as f64 - 0.5);
            let mut near: Vec<Near> =
                seen.iter().filter(|(square, _)| away(*square) < NEAR_SQUARES).copied().collect();
            near.sort_by(|a, b| away(a.0).total_cmp(&away(b.0)));
            near.truncate(4);
            let beside = near.iter().filter(|(square, _)| away(*square) < 1.0).count();
            if near.len() < 2 {
                continue;
            }
            if let Some(corner) = foretold(board, charuco, &near, [q.mm.x, q.mm.y]) {
                corners.push((q, corner));
                is_seen.push(beside == 2);
            }
        }
    }
    let none = || CalibError::NoBoard { picture: name.to_owned(), columns: board.columns(), rows: board.rows() };
    if is_seen.iter().filter(|is_seen| **is_seen).count() < MIN_CORNERS {
        return Err(none());
    }
    let reach_px = corners.iter().map(|(_, (_, reach_px))| *reach_px).fold(f64::INFINITY, f64::min);
    let chosen_px = half_window_px.unwrap_or(reach_px.clamp(3.0, 11.0) as usize);
    if half_window_px.is_some() {
        let mut kept = is_seen.iter();
        corners.retain(|_| kept.next().copied().unwrap_or(false));
    }
    let rough: Vec<Pixel> = corners.iter().map(|(_, (pixel, _))| *pixel).collect();
    let refined = foreign::refine_corners(picture, &rough, chosen_px)?;
    let corners = corners.iter().map(|(q, _)| *q).zip(refined).collect();
    let found = Detected { corners, half_window_px: chosen_px, modelled: 0 };
    let found = if half_window_px.is_none() { modelled(picture, board, found, &is_seen) } else { found };
    if found.corners.len() < MIN_CORNERS { Err(none()) } else { Ok(found) }
}

/// The markers that lie where one plane has all of them: without those of something else, or wrongly read.
fn of_one_plane(mut markers: Vec<Near>, board: &Board, charuco: &Charuco) -> Vec<Near> {
    while markers.len() >= 3 {
        let (places, pixels) = placed(board, charuco, &markers);
        let Some(plane) = foreign::homography(&places, &pixels) else { return Vec::new() };
        let apart = |index: usize| {
            let corners = 4 * index..4 * index + 4;
            let side_px = pixels[corners.start].distance_px(pixels[corners.start + 1]);
            let off = corners.map(|at| pixel_of(&plane, places[at]).distance_px(pixels[at]));
            off.fold(0.0, f64::max) / side_px
        };
        let farthest = (0..markers.len()).map(|index| (index, apart(index))).max_by(|a, b| a.1.total_cmp(&b.1));
        match farthest {
            Some((index, apart)) if apart > BENT_WHOLE => markers.remove(index),
            _ => break,
        };
    }
    markers
}

/// The places of markers' corners on the board, mm, and where they are seen.
fn placed(board: &Board, charuco: &Charuco, markers: &[Near]) -> (Vec<[f64; 2]>, Vec<Pixel>) {
    let (square, inset) = (board.square_mm(), (board.square_mm() - charuco.marker_mm) / 2.0);
    let side = charuco.marker_mm;
    let place = |((column, row), corners): &Near| {
        let low = [*column as f64 - 1.0, *row as f64 - 1.0].map(|index| index * square + inset);
        let offsets = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
        let places = offsets.map(|[x, y]| [low[0] + x, low[1] + y]);
        places.into_iter().zip(*corners).collect::<Vec<_>>()
    };
    markers.iter().flat_map(place).unzip()
}

fn pixel_of(plane: &nalgebra::Matrix3<f64>, [x, y]: [f64; 2]) -> Pixel {
    let p = plane * nalgebra::Vector3::new(x, y, 1.0);
    Pixel::at(p.x / p.z, p.y / p.z)
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

/// Where a corner of the board is, from the markers near it, and a window around it that is clear of markers, px.
fn foretold(board: &Board, charuco: &Charuco, near: &[Near], at: [f64; 2]) -> Option<(Pixel, f64)> {
    let (places, pixels) = placed(board, charuco, near);
    let places: Vec<[f64; 2]> = places.iter().map(|[x, y]| [x - at[0], y - at[1]]).collect();
    let plane = foreign::homography(&places, &pixels)?;
    let corner = pixel_of(&plane, [0.0, 0.0]);
    let inset = (board.square_mm() - charuco.marker_mm) / 2.0;
    let around = [[-inset, -inset], [inset, -inset], [inset, inset], [-inset, inset]];
    let nearest =
        around.iter().map(|place| pixel_of(&plane, *place).distance_px(corner)).fold(f64::INFINITY, f64::min);
    // Markers of another layout, or of another board, do not lie on one plane together.
    let side_px = pixels[0].distance_px(pixels[1]);
    let is_bent = places
        .iter()
        .zip(&pixels)
        .any(|(place, pixel)| pixel_of(&plane, *place).distance_px(*pixel) > BENT * side_px);
    // The marker's corner is √2 insets away, the window's side only one: 0.6 of the way is clear of it.
    (!is_bent).then_some((corner, 0.6 * nearest))
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
