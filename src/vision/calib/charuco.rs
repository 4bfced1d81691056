//! ChArUco boards: their markers identify the corners, even if a part of the board is covered.
//!
//! OpenCV's aruco module finds the markers. The corners of the squares are predicted from the corners of the
//! markers and located by the print around them (`print`). Each located corner predicts the next ones, so a few
//! markers are enough. If that finds too few corners, the lattice of a chessboard (`charuco_lattice`) is used,
//! which needs no readable marker. The layout is defined in this program, so that any version reads boards printed
//! by OpenCV before 4.6 (`legacy`) and since.

use super::board::{Board, Charuco, Corners};
use super::charuco_grow::{CornerMap, Search};
use super::charuco_lattice::{Cells, assign_lattice};
use super::chessboard;
use super::crossings::{SmoothedPicture, noise};
use super::error::CalibError;
use super::foreign;
use super::placing::{DetectedCorners, refine_subpix, refine_with_model, shortest_px};
use super::print::Print;
use super::surface::homography_pixel;
use panelprep_base::geometry::{GrayPicture, Pixel};
use panelprep_cell::imaging::ImagingError;
use std::collections::BTreeMap;

/// Minimum number of corners that determine the board's position well.
const MIN_CORNERS: usize = 8;
/// Maximum distance of a marker's corner from the common plane of all, as a share of the marker's side: a lens
/// bends far less.
const MAX_PLANE_DISTANCE_SHARE: f64 = 0.6;
/// If the markers lead to at least this fraction of the corners, the others are regarded as hidden, and no lattice is
/// searched.
const MIN_CORNER_SHARE: f64 = 0.6;
/// Maximum number of lattices of one search pass that are compared with the board.
const MAX_LATTICES: usize = 6;

/// Finds the board, or reports which other board the picture shows.
pub(super) fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    charuco: &Charuco,
    half_window_px: Option<usize>,
) -> Result<DetectedCorners, CalibError> {
    let missing = match detect_board(name, picture, board, charuco, half_window_px) {
        Err(error @ CalibError::NoBoard { .. }) => error,
        other => return other,
    };
    let shows = |picture: &GrayPicture, board: &Board| {
        let markers = board.markers()?;
        let corners = detect_board(name, picture, board, markers, None).ok()?.corners.len();
        // A few markers of another layout may lie as in this one. Only the layout that the picture really shows is
        // found completely.
        (corners as f64 >= MIN_CORNER_SHARE * board.count() as f64).then_some(corners)
    };
    let other = |what: String| CalibError::OtherCharuco { picture: name.to_owned(), what };
    let dictionary = &charuco.dictionary;
    let own =
        foreign::dictionary_number(dictionary).map_or(Ok(vec![]), |number| detect_in_reduced(picture, number))?;
    if own.len() >= MIN_BOARD_MARKERS {
        let tried = board
            .alternative_layouts()
            .into_iter()
            .filter_map(|(asked, words)| Some((shows(picture, &asked)?, asked, words)));
        if let Some((_, asked, words)) = tried.max_by_key(|(corners, ..)| *corners) {
            return Err(other(format!("the board's markers were found {words}; use --board {}", asked.text())));
        }
        return Err(other(format!(
            "{} markers of {dictionary} were found in another layout: count the board's squares along both sides, \
             and measure square and marker",
            own.len()
        )));
    }
    let mirrored = mirror_picture(picture);
    if shows(&mirrored, board).is_some() {
        return Err(other("the picture is mirrored: use the picture as the camera's sensor sees it".to_owned()));
    }
    for candidate in DICTIONARIES.iter().filter(|candidate| *candidate != dictionary) {
        let Some(number) = foreign::dictionary_number(candidate) else { continue };
        let markers = detect_in_reduced(picture, number)?;
        if markers.len() >= MIN_OTHER_BOARD_MARKERS {
            return Err(other(format!(
                "the picture shows {} markers of the dictionary {candidate}, and none of {dictionary}: correct the \
                 dictionary in --board",
                markers.len()
            )));
        }
    }
    Err(missing)
}

/// At least this number of markers shows a board; fewer may be chance.
const MIN_BOARD_MARKERS: usize = 4;
/// At least this number of markers shows a board of a dictionary that the user did not name.
const MIN_OTHER_BOARD_MARKERS: usize = 6;
/// The largest dictionary of each family, which begins with the markers of the smaller ones.
const DICTIONARIES: [&str; 9] = [
    "4X4_1000",
    "5X5_1000",
    "6X6_1000",
    "7X7_1000",
    "ARUCO_ORIGINAL",
    "APRILTAG_16H5",
    "APRILTAG_25H9",
    "APRILTAG_36H10",
    "APRILTAG_36H11",
];
/// A picture of this width is enough to read markers, px.
const REDUCED_WIDTH_PX: usize = 1_200;

/// Returns the markers of a dictionary in a picture of moderate size.
fn detect_in_reduced(picture: &GrayPicture, dictionary: i32) -> Result<Vec<(usize, [Pixel; 4])>, ImagingError> {
    let times = picture.width.max(picture.height).div_ceil(REDUCED_WIDTH_PX).max(1);
    let small = if times == 1 { None } else { Some(foreign::reduce_picture(picture, times)?) };
    foreign::detect_markers(small.as_ref().unwrap_or(picture), dictionary)
}

fn mirror_picture(picture: &GrayPicture) -> GrayPicture {
    let rows = picture.gray.chunks(picture.width.max(1));
    let gray = rows.flat_map(|row| row.iter().rev().copied()).collect();
    GrayPicture { gray, ..picture.clone() }
}

fn detect_board(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    charuco: &Charuco,
    half_window_px: Option<usize>,
) -> Result<DetectedCorners, CalibError> {
    let unknown = || CalibError::Board {
        text: charuco.dictionary.clone(),
        message: "OpenCV has no dictionary with this name".to_owned(),
    };
    let dictionary = foreign::dictionary_number(&charuco.dictionary).ok_or_else(unknown)?;
    let squares = board.marker_squares();
    let found = markers(picture, dictionary, squares.len())?;
    let seen = filter_coplanar(
        found.iter().map(|(number, corners)| (squares[*number], *corners)).collect(),
        board,
        charuco,
    );
    let cells = marker_cells(board)?;
    let print = Print::from_board(board, &cells);
    let search = Search {
        picture,
        board,
        print: &print,
        smoothed: &SmoothedPicture::from_picture(picture),
        noise: noise(picture),
    };
    let (places, pixels) = match_markers(board, charuco, &seen);
    let mut best = search.grow(places.into_iter().zip(pixels).collect());
    let cells: Cells = squares.into_iter().zip(cells).collect();
    if (best.len() as f64) < MIN_CORNER_SHARE * board.count() as f64 {
        let by_lattice = detect_from_lattices(&search, &cells)?;
        if by_lattice.len() > best.len() {
            best = by_lattice;
        }
    }
    let none = || CalibError::NoBoard { picture: name.to_owned(), columns: board.columns(), rows: board.rows() };
    if best.len() < MIN_CORNERS || !search.shows_markers(&best, &cells) {
        return Err(none());
    }
    let inset = (board.square_mm() - charuco.marker_mm) / 2.0 / board.square_mm();
    let mut corners: Corners = best.values().copied().collect();
    if half_window_px.is_some() {
        return Ok(refine_subpix(picture, &corners, board.square_mm(), half_window_px)?);
    }
    // The window must not extend beyond the markers.
    let half_window_px = (1.2 * inset * shortest_px(&corners, board.square_mm())).clamp(3.0, 11.0) as usize;
    let mut is_seen = vec![true; corners.len()];
    corners.extend(search.predict_missing(&best));
    is_seen.resize(corners.len(), false);
    let found = DetectedCorners { corners, half_window_px, modelled_count: 0 };
    let found = refine_with_model(picture, board, found, &is_seen, &print);
    if found.corners.len() < MIN_CORNERS { Err(none()) } else { Ok(found) }
}

/// Returns the markers that fit one common plane, without those of other objects or wrongly read ones.
fn filter_coplanar(mut markers: Vec<GridSquare>, board: &Board, charuco: &Charuco) -> Vec<GridSquare> {
    while markers.len() >= 3 {
        let (places, pixels) = match_markers(board, charuco, &markers);
        let Some(plane) = foreign::homography(&places, &pixels) else { return Vec::new() };
        let apart = |index: usize| {
            let corners = 4 * index..4 * index + 4;
            let side_px = pixels[corners.start].distance_px(pixels[corners.start + 1]);
            let off = corners.map(|at| homography_pixel(&plane, places[at]).distance_px(pixels[at]));
            off.fold(0.0, f64::max) / side_px
        };
        let farthest = (0..markers.len()).map(|index| (index, apart(index))).max_by(|a, b| a.1.total_cmp(&b.1));
        match farthest {
            Some((index, apart)) if apart > MAX_PLANE_DISTANCE_SHARE => markers.remove(index),
            _ => break,
        };
    }
    markers
}

/// Returns the positions of the markers' corners on the board, mm, and their pixels.
fn match_markers(board: &Board, charuco: &Charuco, markers: &[GridSquare]) -> (Vec<[f64; 2]>, Vec<Pixel>) {
    let (square, inset) = (board.square_mm(), (board.square_mm() - charuco.marker_mm) / 2.0);
    let side = charuco.marker_mm;
    let place = |((column, row), corners): &GridSquare| {
        let low = [*column as f64 - 1.0, *row as f64 - 1.0].map(|index| index * square + inset);
        let offsets = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
        let places = offsets.map(|[x, y]| [low[0] + x, low[1] + y]);
        places.into_iter().zip(*corners).collect::<Vec<_>>()
    };
    markers.iter().flat_map(place).unzip()
}

/// Returns the markers with their numbers, from search passes at growing picture sizes: a large board is found
/// completely in a small picture, and the last pass is limited like the one for a chessboard. The corners are those
/// of the largest picture in which the marker was found.
fn markers(
    picture: &GrayPicture,
    dictionary: i32,
    count: usize,
) -> Result<BTreeMap<usize, [Pixel; 4]>, ImagingError> {
    let mut all = BTreeMap::new();
    for times in chessboard::reduction_factors(picture) {
        let small = if times == 1 { None } else { Some(foreign::reduce_picture(picture, times)?) };
        let small = small.as_ref().unwrap_or(picture);
        let across = picture.width as f64 / small.width as f64;
        let down = picture.height as f64 / small.height as f64;
        let whole = |pixel: Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
        let found = foreign::detect_markers(small, dictionary)?;
        all.extend(
            found.into_iter().filter(|(number, _)| *number < count).map(|(n, corners)| (n, corners.map(whole))),
        );
        if all.len() == count {
            break;
        }
    }
    Ok(all)
}

type GridSquare = ((usize, usize), [Pixel; 4]);

/// Returns the largest part of the board that is found from lattices of corners.
fn detect_from_lattices(search: &Search, cells: &Cells) -> Result<CornerMap, ImagingError> {
    let (side, mut best) = (search.board.square_mm(), CornerMap::new());
    for times in chessboard::reduction_factors(search.picture) {
        let mut grids = chessboard::detect_lattices(search.picture, times)?;
        grids.sort_by_key(|grid| std::cmp::Reverse(grid.seen_count()));
        for grid in grids.into_iter().filter(|grid| grid.seen_count() >= MIN_CORNERS).take(MAX_LATTICES) {
            let Some(corners) = assign_lattice(search.smoothed, &grid, search.board, cells) else { continue };
            let known =
                corners.into_iter().map(|((c, r), pixel)| ([f64::from(c) * side, f64::from(r) * side], pixel));
            let grown = search.grow(known.collect());
            if grown.len() > best.len() {
                best = grown;
            }
            if best.len() == search.board.count() {
                return Ok(best);
            }
        }
    }
    Ok(best)
}

/// Returns the cells of a board's markers with their rims, in the order of [`Board::marker_squares`]: for printing
/// the board.
///
/// # Errors
/// If the dictionary is unknown or has too few markers.
pub fn marker_cells(board: &Board) -> Result<Vec<Vec<bool>>, CalibError> {
    let Some(charuco) = board.markers() else { return Ok(Vec::new()) };
    let unknown = || CalibError::Board {
        text: charuco.dictionary.clone(),
        message: "OpenCV has no dictionary with this name".to_owned(),
    };
    let dictionary = foreign::dictionary_number(&charuco.dictionary).ok_or_else(unknown)?;
    let cells = (0..board.marker_squares().len()).map(|number| foreign::marker_cells(dictionary, number));
    Ok(cells.collect::<Result<_, _>>()?)
}
