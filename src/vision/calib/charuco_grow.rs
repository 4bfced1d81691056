//! Grows the corners of a ChArUco board: each corner is predicted from those around it and located by the print.
//!
//! Each located corner predicts the next ones. A board is accepted if the picture shows its markers between the corners.

use super::board::{Board, Corners};
use super::charuco_lattice::{Cells, MIN_PRINT_CORRELATION, correlation};
use super::crossings::SmoothedPicture;
use super::foreign;
use super::print::{MatchWindow, Print};
use super::surface::{BLUR_CORNERS, PRINT_PX, PRINT_SQUARES, homography_pixel};
use nalgebra::Matrix3;
use panelprep_base::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point};
use std::collections::BTreeMap;

/// A corner is predicted from the known corners within `PREDICTION_RADIUS_SQUARES` squares, at most `MAX_NEIGHBOURS` of them.
const PREDICTION_RADIUS_SQUARES: f64 = 2.6;
const MAX_NEIGHBOURS: usize = 20;
/// Limits of the search: its rounds, the standard deviation of a corner, px, and the distance of a corner from its
/// prediction, as a share of a square's side.
const MAX_ROUNDS: usize = 12;
const KNOWN_PX: f64 = 0.6;
const MOVED: f64 = 0.2;

/// Positions on the board, mm, and their pixels.
pub(super) type PointPairs = Vec<([f64; 2], Pixel)>;
/// Corners by column and row.
pub(super) type CornerMap = BTreeMap<(usize, usize), (Point<BoardFrame>, Pixel)>;

/// The search for corners from known neighbours.
pub(super) struct Search<'a> {
    pub picture: &'a GrayPicture,
    pub board: &'a Board,
    pub print: &'a Print,
    pub smoothed: &'a SmoothedPicture,
    pub noise: f64,
}

impl Search<'_> {
    /// Returns all corners that are found from the known ones, each from the corners near it.
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
                let step = (views.len() / BLUR_CORNERS).max(1);
                let some: Vec<MatchWindow> = views.iter().step_by(step).map(|(_, view)| *view).collect();
                self.print.blur_px(self.picture, &some, self.noise)
            });
            let found = views.into_iter().filter_map(|(at, view)| {
                let found = self.print.match_near(self.picture, &MatchWindow { blur_px, ..view }, self.noise)?;
                let is_near = found.pixel.distance_px(view.start) < MOVED * self.square_px(&view);
                (found.contrast > 0.0 && found.deviation_px < KNOWN_PX && is_near).then_some((at, found.pixel))
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

    /// Predicts the corners that were not found from those that were found.
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

    /// Returns whether the picture shows the markers at the positions that the corners predict, both in the odd rows
    /// of squares and in the even ones. In a board's other pattern (`legacy`) every second row has the same markers at
    /// the same positions.
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

    /// Returns a corner's view as its neighbours predict it.
    fn view(&self, known: &PointPairs, column: usize, row: usize) -> Option<MatchWindow> {
        let q = self.board.corner(column, row)?;
        let place = [q.mm.x, q.mm.y];
        let plane = self.plane(known, place)?;
        let start = homography_pixel(&plane, place);
        let reach_mm = PRINT_SQUARES * self.board.square_mm();
        Some(MatchWindow { plane, place, start, reach_mm, most_px: PRINT_PX, blur_px: 1.0 })
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

/// Returns the inner corners of a square: the square (c, r) lies between the corners (c − 1, r − 1) and (c, r).
fn square_corners((column, row): (usize, usize)) -> Vec<(usize, usize)> {
    let before = |index: usize| index.checked_sub(1).into_iter().chain([index]);
    before(row).flat_map(|row| before(column).map(move |column| (column, row))).collect()
}
