//! ChArUco boards: their markers identify the corners, even if a part of the board is covered.
//!
//! OpenCV's aruco module detects the markers. The corners of the squares are predicted from the corners of the markers
//! and located by the print around them (`print`). Each located corner predicts the next ones, so a few markers are
//! enough. A board is accepted if the picture shows its markers between the corners. The layout is defined in this
//! program, so that any version reads boards printed by OpenCV before 4.6 (`legacy`) and since.
//!
//! If this search finds too few corners, the lattice of a chessboard is used, which needs no readable marker. The
//! squares meet in corners as those of a chessboard do. `chessboard` joins these corners to a lattice even if blur,
//! noise or a glare hides the codes of the markers. The lattice can be assigned to the board in four rotations and at
//! several positions. For each assignment the grey levels at the centres of all cells are compared with the print,
//! square by square. One assignment must be clearly the best.

use super::board::{Board, Charuco, Corners};
use super::chessboard::Grid;
use super::crossings::{SmoothedPicture, noise};
use super::error::CalibError;
use super::placing::{
    BLUR_CORNER_COUNT, DetectedCorners, MAX_PRINT_REACH_PX, PRINT_REACH_SQUARES, homography_pixel, refine_subpix,
    refine_with_model, shortest_px,
};
use super::print::{MatchWindow, Print};
use super::{chessboard, foreign};
use nalgebra::{Matrix3, Vector2, Vector3};
use panelprep_base::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point};
use panelprep_cell::imaging::ImagingError;
use std::collections::BTreeMap;

/// Minimum number of corners that determine the position of the board well.
const MIN_CORNERS: usize = 8;
/// Maximum distance of a corner of a marker from the common plane of all markers, as a fraction of the side of the
/// marker. The distortion of a lens causes a much smaller distance.
const MAX_RELATIVE_PLANE_DISTANCE: f64 = 0.6;
/// Minimum fraction of the corners that the markers must lead to; the other corners are then treated as hidden, and the
/// search for a lattice is omitted.
const MIN_CORNER_FRACTION: f64 = 0.6;
/// Maximum number of lattices that are compared with the board in one search pass.
const MAX_LATTICES: usize = 6;

/// Detects the board, or reports which other board the picture shows.
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
        // A few markers of another layout may agree with this layout. Only the layout that the picture shows is found
        // completely.
        (corners as f64 >= MIN_CORNER_FRACTION * board.count() as f64).then_some(corners)
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

/// Minimum number of markers of a detected board; fewer may be found by chance.
const MIN_BOARD_MARKERS: usize = 4;
/// Minimum number of markers of a detected board whose dictionary the user did not name.
const MIN_OTHER_BOARD_MARKERS: usize = 6;
/// The largest dictionary of each family; it begins with the markers of the smaller dictionaries.
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
/// Maximum longer side of a reduced picture, px: this is enough to read markers.
const MAX_REDUCED_SIDE_PX: usize = 1_200;

/// Returns the markers of a dictionary in a picture that is reduced to at most `MAX_REDUCED_SIDE_PX`.
fn detect_in_reduced(picture: &GrayPicture, dictionary: i32) -> Result<Vec<(usize, [Pixel; 4])>, ImagingError> {
    let times = picture.width.max(picture.height).div_ceil(MAX_REDUCED_SIDE_PX).max(1);
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
        message: "OpenCV has no dictionary with this name; use a name such as 4X4_50".to_owned(),
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
    if (best.len() as f64) < MIN_CORNER_FRACTION * board.count() as f64 {
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

/// Returns the markers on one common plane. Markers of other objects and wrongly read markers are removed.
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
            Some((index, apart)) if apart > MAX_RELATIVE_PLANE_DISTANCE => markers.remove(index),
            _ => break,
        };
    }
    markers
}

/// Returns the positions of the marker corners on the board, mm, and their pixels.
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

/// Returns the markers with their numbers, from search passes at increasing picture sizes: a large board is found
/// completely in a small picture, and the size of the last pass is limited as for a chessboard. The corners are those
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

/// Returns the largest part of the board that the lattices of corners show.
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

/// Returns the cells of the markers of a board with their black rims, in the order of [`Board::marker_squares`], for
/// printing the board.
///
/// # Errors
/// If the dictionary is unknown or has too few markers.
pub fn marker_cells(board: &Board) -> Result<Vec<Vec<bool>>, CalibError> {
    let Some(charuco) = board.markers() else { return Ok(Vec::new()) };
    let unknown = || CalibError::Board {
        text: charuco.dictionary.clone(),
        message: "OpenCV has no dictionary with this name; use a name such as 4X4_50".to_owned(),
    };
    let dictionary = foreign::dictionary_number(&charuco.dictionary).ok_or_else(unknown)?;
    let cells = (0..board.marker_squares().len()).map(|number| foreign::marker_cells(dictionary, number));
    Ok(cells.collect::<Result<_, _>>()?)
}

/// Radius around a corner within which known corners predict it, in squares; at most `MAX_NEIGHBOURS` of them are used.
const PREDICTION_RADIUS_SQUARES: f64 = 2.6;
const MAX_NEIGHBOURS: usize = 20;
/// Limits of the search: number of iterations (`MAX_ROUNDS`), standard deviation of a corner, px (`MAX_CORNER_STD_PX`),
/// and distance of a corner from its prediction, as a fraction of the side of a square
/// (`MAX_RELATIVE_PREDICTION_ERROR`).
const MAX_ROUNDS: usize = 12;
const MAX_CORNER_STD_PX: f64 = 0.6;
const MAX_RELATIVE_PREDICTION_ERROR: f64 = 0.2;

/// Positions on the board, mm, each with its pixel.
pub(super) type PointPairs = Vec<([f64; 2], Pixel)>;
/// Corners by column and row, each as a point on the board and its pixel.
pub(super) type CornerMap = BTreeMap<(usize, usize), (Point<BoardFrame>, Pixel)>;

/// The search for corners from known neighbours.
struct Search<'a> {
    pub picture: &'a GrayPicture,
    pub board: &'a Board,
    pub print: &'a Print,
    pub smoothed: &'a SmoothedPicture,
    pub noise: f64,
}

impl Search<'_> {
    /// Finds further corners from the known ones until no more are found, each from the corners near it, and returns
    /// all corners.
    pub fn grow(&self, mut known: PointPairs) -> CornerMap {
        let mut all = CornerMap::new();
        let mut blur_px = None;
        for _ in 0..MAX_ROUNDS {
            let mut views: Vec<((usize, usize), MatchWindow)> = Vec::new();
            for row in 0..self.board.rows() {
                let columns = (0..self.board.columns()).filter(|column| !all.contains_key(&(*column, row)));
                views.extend(columns.filter_map(|column| Some(((column, row), self.view(&known, column, row)?))));
            }
            let blur_px = *blur_px.get_or_insert_with(|| {
                let step = (views.len() / BLUR_CORNER_COUNT).max(1);
                let some: Vec<MatchWindow> = views.iter().step_by(step).map(|(_, view)| *view).collect();
                self.print.blur_px(self.picture, &some, self.noise)
            });
            let found = views.into_iter().filter_map(|(at, view)| {
                let found = self.print.match_near(self.picture, &MatchWindow { blur_px, ..view }, self.noise)?;
                let is_near =
                    found.pixel.distance_px(view.start) < MAX_RELATIVE_PREDICTION_ERROR * self.square_px(&view);
                (found.contrast > 0.0 && found.deviation_px < MAX_CORNER_STD_PX && is_near)
                    .then_some((at, found.pixel))
            });
            let found: Vec<((usize, usize), Pixel)> = found.collect();
            if found.is_empty() {
                break;
            }
            for ((column, row), pixel) in found {
                if let Some(q) = self.board.corner(column, row) {
                    known.push(([q.mm.x, q.mm.y], pixel));
                    all.insert((column, row), (q, pixel));
                }
            }
        }
        all
    }

    /// Predicts the missing corners from the found ones.
    pub fn predict_missing(&self, all: &CornerMap) -> Corners {
        let known = known_positions(all);
        let places =
            (0..self.board.rows()).flat_map(|row| (0..self.board.columns()).map(move |column| (column, row)));
        let missing = places.filter(|at| !all.contains_key(at));
        let foretold = missing.filter_map(|(column, row)| {
            let view = self.view(&known, column, row)?;
            view.start.nearest_whole(self.picture.width, self.picture.height)?;
            Some((self.board.corner(column, row)?, view.start))
        });
        foretold.collect()
    }

    /// Returns whether the picture shows the markers at the positions that the corners predict, in the odd rows of
    /// squares as well as in the even rows. In the other pattern of a board (`legacy`), every second row has the same
    /// markers at the same positions.
    pub fn shows_markers(&self, all: &CornerMap, cells: &Cells) -> bool {
        let Some(markers) = self.board.markers() else { return false };
        let (known, side) = (known_positions(all), self.board.square_mm());
        let share = markers.marker_mm / side;
        let mut rows: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
        for (square, cells) in cells {
            let corners = square_corners(*square).into_iter().filter(|at| all.contains_key(at)).count();
            let middle = [square.0, square.1].map(|at| (at as f64 - 0.5) * side);
            let plane = if corners >= 2 { self.plane(&known, middle) } else { None };
            if let Some(plane) = plane {
                let plane = plane * Matrix3::new(side, 0.0, 0.0, 0.0, side, 0.0, 0.0, 0.0, 1.0);
                rows[square.1 % 2].push(correlation(self.smoothed, &plane, *square, (cells, share, 1)));
            }
        }
        rows.iter().all(|all| all.is_empty() || all.iter().sum::<f64>() / all.len() as f64 > MIN_PRINT_CORRELATION)
            && rows.iter().any(|all| !all.is_empty())
    }

    /// Returns the view of a corner that its neighbours predict.
    fn view(&self, known: &PointPairs, column: usize, row: usize) -> Option<MatchWindow> {
        let q = self.board.corner(column, row)?;
        let place = [q.mm.x, q.mm.y];
        let plane = self.plane(known, place)?;
        let start = homography_pixel(&plane, place);
        let reach_mm = PRINT_REACH_SQUARES * self.board.square_mm();
        Some(MatchWindow { plane, place, start, reach_mm, most_px: MAX_PRINT_REACH_PX, blur_px: 1.0 })
    }

    /// Returns the homography from the board, mm, to the picture near a position, from the known corners there.
    fn plane(&self, known: &PointPairs, [x, y]: [f64; 2]) -> Option<Matrix3<f64>> {
        let side = self.board.square_mm();
        let away = |place: [f64; 2]| (place[0] - x).hypot(place[1] - y);
        let mut near: PointPairs =
            known.iter().filter(|(place, _)| away(*place) < PREDICTION_RADIUS_SQUARES * side).copied().collect();
        near.sort_by(|a, b| away(a.0).total_cmp(&away(b.0)));
        near.truncate(MAX_NEIGHBOURS);
        let reach = |axis: usize| {
            let along = near.iter().map(|(place, _)| place[axis]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        if near.len() < 6 || reach(0).min(reach(1)) < 0.6 * side {
            return None;
        }
        let (places, pixels): (Vec<[f64; 2]>, Vec<Pixel>) =
            near.into_iter().map(|(place, pixel)| ([place[0] - x, place[1] - y], pixel)).unzip();
        let shift = Matrix3::new(1.0, 0.0, -x, 0.0, 1.0, -y, 0.0, 0.0, 1.0);
        Some(foreign::homography(&places, &pixels)? * shift)
    }

    /// Returns the shorter side of a square in this view, px.
    fn square_px(&self, view: &MatchWindow) -> f64 {
        let ([x, y], side) = (view.place, self.board.square_mm());
        let there = homography_pixel(&view.plane, view.place);
        let next =
            [[x + side, y], [x, y + side]].map(|place| homography_pixel(&view.plane, place).distance_px(there));
        next[0].min(next[1])
    }
}

fn known_positions(all: &CornerMap) -> PointPairs {
    all.values().map(|(q, pixel)| ([q.mm.x, q.mm.y], *pixel)).collect()
}

/// Returns the inner corners of a square: the square (c, r) is between the corners (c − 1, r − 1) and (c, r).
fn square_corners((column, row): (usize, usize)) -> Vec<(usize, usize)> {
    let before = |index: usize| index.checked_sub(1).into_iter().chain([index]);
    before(row).flat_map(|row| before(column).map(move |column| (column, row))).collect()
}

/// Minimum correlation of the grey levels with the print, over all squares with markers. The correlation must exceed
/// the second-best one by at least `MIN_CORRELATION_MARGIN`.
const MIN_PRINT_CORRELATION: f64 = 0.4;
const MIN_CORRELATION_MARGIN: f64 = 0.15;
/// Minimum number of squares with markers that are compared.
const MIN_COMPARED_SQUARES: usize = 4;

/// Corners by column and row of the board.
type LatticeCorners = Vec<((i32, i32), Pixel)>;

/// The cells of each marker of a board, with the column and row of its square.
pub(super) type Cells = Vec<((usize, usize), Vec<bool>)>;

/// Assigns the corners of a lattice to the corners of the board; `None` if no assignment is clearly the best.
fn assign_lattice(smooth: &SmoothedPicture, grid: &Grid, board: &Board, cells: &Cells) -> Option<LatticeCorners> {
    let share = board.markers()?.marker_mm / board.square_mm();
    let mut seen: LatticeCorners = Vec::new();
    for (index, node) in grid.nodes.iter().enumerate().filter(|(_, node)| node.is_seen) {
        seen.push((((index % grid.columns) as i32, (index / grid.columns) as i32), node.pixel));
    }
    // A woven texture has more corners than a board: the comparison would try thousands of positions.
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
        // Rotates by 90°: (column, row) becomes (row, −column).
        seen.iter_mut().for_each(|(at, _)| *at = (at.1, wide - 1 - at.0));
        (wide, high) = (high, wide);
    }
    scores.sort_by(|a, b| b.0.total_cmp(&a.0));
    let second = scores.get(1).map_or(0.0, |(score, _)| *score);
    let (best, corners) = scores.into_iter().next()?;
    (best > MIN_PRINT_CORRELATION && best > second + MIN_CORRELATION_MARGIN).then_some(corners)
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
    (all.len() >= MIN_COMPARED_SQUARES).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Returns the correlation of the grey levels with the print of a square, without `rim` cells at its border: the
/// outermost cells are black in every marker.
fn correlation(
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
