//! Corners that were found to about a pixel, placed to sub-pixel.
//!
//! `cornerSubPix` moves each to where grey gradients around it meet, and `saddle` fits a model of the grey levels, which is
//! several times as exact. The window of ± N px must hold one corner alone and enough edge: by default N is 0.35 of the
//! shortest distance between neighbours, 3 to 11. Where N is given, the corners are those of `cornerSubPix`, as OpenCV's
//! users know them.

use super::board::Board;
use super::foreign;
use super::saddle;
use crate::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point};
use crate::imaging::ImagingError;
use nalgebra::{Vector2, Vector3};

/// Corners of the board with their pixels.
pub type Corners = Vec<(Point<BoardFrame>, Pixel)>;

/// Corners and the window that refined them.
#[derive(Debug, Clone, PartialEq)]
pub struct Detected {
    /// The corners.
    pub corners: Corners,
    /// Half the window's side, px.
    pub half_window_px: usize,
    /// How many corners the model of the grey levels placed; the others are `cornerSubPix`'s.
    pub modelled: usize,
}

const WINDOW_SHARE: f64 = 0.35;
const WINDOW_PX: (f64, f64) = (3.0, 11.0);

/// All corners of a board, row by row, as `cornerSubPix` places them.
pub(super) fn refined(
    picture: &GrayPicture,
    board: &Board,
    rough: &[Pixel],
    half_window_px: Option<usize>,
) -> Result<Detected, ImagingError> {
    let chosen_px = half_window_px.unwrap_or_else(|| window(rough, board.columns()));
    let pixels = foreign::refine_corners(picture, rough, chosen_px)?;
    Ok(Detected {
        corners: board.corners().into_iter().zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled: 0,
    })
}

/// With every corner placed by the model of the grey levels that has neighbours and fits it.
pub(super) fn modelled(picture: &GrayPicture, board: &Board, found: Detected) -> Detected {
    let placed = models(picture, board, &found);
    let modelled = placed.iter().flatten().count();
    let corners = found.corners.iter().zip(placed).map(|(&(q, pixel), placed)| (q, placed.unwrap_or(pixel)));
    Detected { corners: corners.collect(), modelled, ..found }
}

/// Where the model of the grey levels places each corner; `None` where it does not fit.
pub(super) fn models(picture: &GrayPicture, board: &Board, found: &Detected) -> Vec<Option<Pixel>> {
    let near = |place: Point<BoardFrame>| {
        let at = |(q, _): &&(Point<BoardFrame>, Pixel)| q.distance_mm(place) < 0.1 * board.square_mm();
        found.corners.iter().find(at).map(|(_, pixel)| Vector2::new(pixel.u, pixel.v))
    };
    let edge = |q: Point<BoardFrame>, pixel: Pixel, step: Vector3<f64>| {
        let (here, step) = (Vector2::new(pixel.u, pixel.v), step * board.square_mm());
        let (ahead, behind) = (near(Point::new(q.mm + step)), near(Point::new(q.mm - step)));
        (ahead.is_some() || behind.is_some()).then(|| ahead.unwrap_or(here) - behind.unwrap_or(here))
    };
    let place = |&(q, pixel): &(Point<BoardFrame>, Pixel)| {
        let edges = [edge(q, pixel, Vector3::x())?, edge(q, pixel, Vector3::y())?];
        saddle::refine(picture, pixel, edges, found.half_window_px)
    };
    found.corners.iter().map(place).collect()
}

fn window(corners: &[Pixel], columns: usize) -> usize {
    let across = corners.chunks(columns).flat_map(|row| row.windows(2).map(|pair| pair[0].distance_px(pair[1])));
    let down = corners.iter().zip(corners.iter().skip(columns)).map(|(above, below)| above.distance_px(*below));
    let shortest = across.chain(down).fold(f64::INFINITY, f64::min);
    (WINDOW_SHARE * shortest).clamp(WINDOW_PX.0, WINDOW_PX.1) as usize
}
