//! Refines corners that were found to about a pixel, to sub-pixel accuracy.
//!
//! `cornerSubPix` moves each corner to the intersection of the grey gradients around it, and `saddle` fits a model of
//! the grey levels, which is several times as precise. The window of ± N px must contain only one corner and enough
//! edge: by default N is 0.35 of the shortest distance between neighbours, 3 to 11. If N is given, the corners are
//! those of `cornerSubPix`, as OpenCV's users know them.

use super::board::{Board, Corners};
use super::crossings::noise;
use super::foreign;
use super::print::Print;
use super::saddle;
use super::surface::{
    CornerEstimate, MAX_SINGLE_STD_PX, MAX_SURFACE_STD_PX, PRINT_SQUARES, TERMS, WELL_PX, fit_surface,
    inflate_uncertainty,
};
use nalgebra::{Vector2, Vector3};
use panelprep_base::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point};
use panelprep_cell::imaging::ImagingError;
use std::collections::BTreeMap;

/// Corners and the window that refined them.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedCorners {
    /// The corners.
    pub corners: Corners,
    /// Half the window's side, px.
    pub half_window_px: usize,
    /// The number of corners that the model of the grey levels located; the others come from `cornerSubPix`.
    pub modelled_count: usize,
}

const WINDOW_SHARE: f64 = 0.35;
const WINDOW_PX: (f64, f64) = (3.0, 11.0);

/// Refines the approximate corners of a board by `cornerSubPix`.
pub(super) fn refine_subpix(
    picture: &GrayPicture,
    rough: &Corners,
    square_mm: f64,
    half_window_px: Option<usize>,
) -> Result<DetectedCorners, ImagingError> {
    let chosen_px = half_window_px
        .unwrap_or_else(|| (WINDOW_SHARE * shortest_px(rough, square_mm)).clamp(WINDOW_PX.0, WINDOW_PX.1) as usize);
    let pixels: Vec<Pixel> = rough.iter().map(|(_, pixel)| *pixel).collect();
    let pixels = foreign::refine_corners(picture, &pixels, chosen_px)?;
    Ok(DetectedCorners {
        corners: rough.iter().map(|(q, _)| *q).zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled_count: 0,
    })
}

/// Locates every corner that has neighbours with the model of the grey levels, if the model fits. If the model does
/// not fit, or its position is not accurate, the print is searched for near the position that the other corners
/// predict. The less accurate a corner is because of noise, the more it is moved to the smooth surface through all
/// corners. A corner that is still not accurate enough is left out.
pub(super) fn refine_with_model(
    picture: &GrayPicture,
    board: &Board,
    found: DetectedCorners,
    is_seen: &[bool],
    print: &Print,
) -> DetectedCorners {
    let window_px = found.half_window_px;
    let model = Model::new(picture, &found.corners, board.square_mm());
    let mut placed: Vec<Option<CornerEstimate>> =
        found.corners.iter().map(|(q, pixel)| model.predict_corner(*q, *pixel, window_px)).collect();
    let enough = 2 * placed.iter().flatten().count() >= found.corners.len();
    // If the model locates too few corners, the other corners that were seen are accurate enough as a start.
    let begun: Vec<Option<CornerEstimate>> = match enough {
        true => placed.clone(),
        false => found
            .corners
            .iter()
            .zip(&placed)
            .zip(is_seen)
            .map(|(((_, pixel), placed), is_seen)| {
                placed.or(is_seen.then_some(CornerEstimate {
                    pixel: *pixel,
                    deviation_px: MAX_SURFACE_STD_PX,
                    contrast: 0.0,
                }))
            })
            .collect(),
    };
    let enough = 2 * begun.iter().flatten().count() >= found.corners.len();
    let Some(mut surface) = fit_surface(&found.corners, &begun, picture).filter(|_| enough) else {
        return accept_individually(found, placed, is_seen);
    };
    let reach_mm = PRINT_SQUARES * board.square_mm();
    let mut blur_px = None;
    for _ in 0..2 {
        for ((q, _), placed) in found.corners.iter().zip(&mut placed) {
            let there = surface.pixel_at(*q);
            let is_near = |found: &CornerEstimate| found.pixel.distance_px(there) <= surface.limit_px(*q, found);
            *placed = placed.filter(is_near).or_else(|| model.predict_corner(*q, there, window_px).filter(is_near));
            if placed.is_none_or(|placed| placed.deviation_px > WELL_PX) {
                let blur_px = *blur_px.get_or_insert_with(|| {
                    surface.blur_px(picture, print, (&found.corners, reach_mm), model.noise)
                });
                let by_print = print.match_near(picture, &surface.view(*q, reach_mm, blur_px), model.noise);
                let by_print = by_print
                    .filter(|found| found.contrast > 0.0)
                    .map(|found| CornerEstimate::from_match(&found, model.noise));
                let better =
                    |own: &CornerEstimate| placed.is_none_or(|placed| own.deviation_px < placed.deviation_px);
                *placed = by_print.filter(is_near).filter(better).or(*placed);
            }
        }
        let Some(next) = fit_surface(&found.corners, &placed, picture) else { break };
        surface = next;
    }
    let placed = inflate_uncertainty(&found.corners, placed, board.square_mm());
    let surface = fit_surface(&found.corners, &placed, picture).unwrap_or(surface);
    let drawn = found.corners.iter().zip(placed).filter_map(|((q, _), placed)| {
        let placed = placed
            .filter(|placed| placed.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, placed))?;
        surface.blend_with_surface(*q, placed).map(|pixel| (*q, pixel))
    });
    let corners: Corners = drawn.collect();
    DetectedCorners { modelled_count: corners.len(), corners, ..found }
}

/// Returns the corners if too few are located to compare them: those that the model locates well, or that were
/// seen.
fn accept_individually(
    found: DetectedCorners,
    placed: Vec<Option<CornerEstimate>>,
    is_seen: &[bool],
) -> DetectedCorners {
    let well = |placed: Option<CornerEstimate>| {
        placed.filter(|placed| placed.deviation_px < MAX_SINGLE_STD_PX).map(|placed| placed.pixel)
    };
    let placed: Vec<Option<Pixel>> = placed.into_iter().map(well).collect();
    let modelled = placed.iter().flatten().count();
    let is_large = found.corners.len() >= 2 * TERMS;
    let seen = is_seen.iter().copied().chain(std::iter::repeat(true));
    let kept = found.corners.iter().zip(placed.iter().zip(seen)).filter_map(|((q, pixel), (placed, is_seen))| {
        let without = (is_seen && !is_large).then_some(*pixel);
        placed.or(without).map(|pixel| (*q, pixel))
    });
    DetectedCorners { corners: kept.collect(), modelled_count: modelled, ..found }
}

/// The model of the grey levels around corners; their neighbours give the directions of their edges.
struct Model<'a> {
    picture: &'a GrayPicture,
    noise: f64,
    neighbours: BoardNeighbours,
}

impl<'a> Model<'a> {
    fn new(picture: &'a GrayPicture, corners: &Corners, square_mm: f64) -> Self {
        Model { picture, noise: noise(picture), neighbours: BoardNeighbours::from_corners(corners, square_mm) }
    }

    /// Returns the model's position of a corner, from a start; `None` if the model does not fit.
    fn predict_corner(&self, q: Point<BoardFrame>, start: Pixel, half_window_px: usize) -> Option<CornerEstimate> {
        let edges = [self.edge(q, start, Vector3::x())?, self.edge(q, start, Vector3::y())?];
        let found = saddle::refine(self.picture, start, edges, half_window_px, self.noise)?;
        Some(CornerEstimate::from_saddle(&found)).filter(|placed| placed.deviation_px < MAX_SURFACE_STD_PX)
    }

    fn edge(&self, q: Point<BoardFrame>, pixel: Pixel, step: Vector3<f64>) -> Option<Vector2<f64>> {
        let (here, step) = (Vector2::new(pixel.u, pixel.v), step * self.neighbours.square_mm);
        let (ahead, behind) = (self.neighbours.pixel_at(q.mm + step), self.neighbours.pixel_at(q.mm - step));
        (ahead.is_some() || behind.is_some()).then(|| ahead.unwrap_or(here) - behind.unwrap_or(here))
    }
}

/// Corners by their position on the board.
struct BoardNeighbours {
    square_mm: f64,
    pixels: BTreeMap<(i64, i64), Vector2<f64>>,
}

impl BoardNeighbours {
    fn from_corners(corners: &Corners, square_mm: f64) -> Self {
        let mut all = BoardNeighbours { square_mm, pixels: BTreeMap::new() };
        for (q, pixel) in corners {
            all.pixels.insert(all.key(q.mm), Vector2::new(pixel.u, pixel.v));
        }
        all
    }

    fn key(&self, place: nalgebra::Point3<f64>) -> (i64, i64) {
        let index = |mm: f64| (mm / self.square_mm).round() as i64;
        (index(place.x), index(place.y))
    }

    fn pixel_at(&self, place: nalgebra::Point3<f64>) -> Option<Vector2<f64>> {
        self.pixels.get(&self.key(place)).copied()
    }
}

/// Returns the shortest distance between neighbours, px.
pub(super) fn shortest_px(corners: &Corners, square_mm: f64) -> f64 {
    let by_place = BoardNeighbours::from_corners(corners, square_mm);
    let next = |q: &Point<BoardFrame>, pixel: &Pixel, step: Vector3<f64>| {
        let there = by_place.pixel_at(q.mm + step * square_mm)?;
        Some((there - Vector2::new(pixel.u, pixel.v)).norm())
    };
    let both = |(q, pixel): &(Point<BoardFrame>, Pixel)| {
        [Vector3::x(), Vector3::y()]
            .into_iter()
            .filter_map(|step| next(q, pixel, step))
            .fold(f64::INFINITY, f64::min)
    };
    corners.iter().map(both).fold(f64::INFINITY, f64::min)
}
