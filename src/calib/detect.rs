//! Where a picture shows the board's corners, to sub-pixel.
//!
//! `findChessboardCorners` finds them to about a pixel, `cornerSubPix` moves each to where grey gradients around it
//! meet, and `saddle` fits a model of the grey levels, which is several times as exact. The window of ± N px must hold one
//! corner alone and enough edge: by default N is 0.35 of the shortest distance between neighbours, 3 to 11. Where N is
//! given, the corners are those of `cornerSubPix`, as OpenCV's users know them. A board with a unique first corner is turned so that the outer square there is black;
//! of others the picture's own order stays, upper left first.

use super::board::Board;
use super::chain::Seen;
use super::charuco;
use super::error::CalibError;
use super::foreign;
use super::saddle;
use crate::geometry::{Board as BoardFrame, Frame, GrayPicture, OrganizedCloud, Pixel, Point, Vector, local_plane};
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

/// Finds the board's corners. `half_window_px` overrides the window; `name` is the picture's in messages.
///
/// # Errors
/// Where the picture shows no such board, or too little of a ChArUco board.
pub fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    half_window_px: Option<usize>,
) -> Result<Detected, CalibError> {
    match board.markers() {
        Some(markers) => charuco::detect(name, picture, board, markers, half_window_px),
        None => chessboard(name, picture, board, half_window_px),
    }
}

fn chessboard(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    half_window_px: Option<usize>,
) -> Result<Detected, CalibError> {
    let (columns, rows) = (board.columns(), board.rows());
    let found = foreign::chessboard(picture, columns, rows)?;
    let mut rough = found.ok_or_else(|| CalibError::NoBoard { picture: name.to_owned(), columns, rows })?;
    if turned_wrong(&rough, picture, board) {
        rough.reverse();
    }
    let chosen_px = half_window_px.unwrap_or_else(|| window(&rough, columns));
    let pixels = foreign::refine_corners(picture, &rough, chosen_px)?;
    let found = Detected {
        corners: board.corners().into_iter().zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled: 0,
    };
    Ok(if half_window_px.is_none() { modelled(picture, board, found) } else { found })
}

/// With every corner placed by the model of the grey levels that has neighbours and fits it.
pub(super) fn modelled(picture: &GrayPicture, board: &Board, found: Detected) -> Detected {
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
    let placed: Vec<Option<Pixel>> = found.corners.iter().map(place).collect();
    let modelled = placed.iter().flatten().count();
    let corners = found.corners.iter().zip(placed).map(|(&(q, pixel), placed)| (q, placed.unwrap_or(pixel)));
    Detected { corners: corners.collect(), modelled, ..found }
}

fn window(corners: &[Pixel], columns: usize) -> usize {
    let across = corners.chunks(columns).flat_map(|row| row.windows(2).map(|pair| pair[0].distance_px(pair[1])));
    let down = corners.iter().zip(corners.iter().skip(columns)).map(|(above, below)| above.distance_px(*below));
    let shortest = across.chain(down).fold(f64::INFINITY, f64::min);
    (WINDOW_SHARE * shortest).clamp(WINDOW_PX.0, WINDOW_PX.1) as usize
}

/// Is the outer square at the first corner white, or, where that decides nothing, the first corner below the last?
fn turned_wrong(corners: &[Pixel], picture: &GrayPicture, board: &Board) -> bool {
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

/// Half the side of the neighbourhood from which a corner's point is taken, px.
const PLANE_PX: usize = 8;

/// The corners as the 3D camera measured them: its ray at the corner meets the plane of the points around it. Corners
/// with too few points are left out.
pub fn measured<C: Frame>(
    cloud: &OrganizedCloud<C>,
    camera: &crate::geometry::PinholeCamera,
    corners: &Corners,
) -> Seen<C> {
    let origin = Point::at(0.0, 0.0, 0.0);
    let point = |pixel: Pixel| {
        let at = pixel.whole(cloud.width(), cloud.height())?;
        let ray: Vector<C> = camera.unproject(pixel)?;
        local_plane(cloud, at, PLANE_PX, origin)?.meet(origin, ray)
    };
    Seen::Points(corners.iter().filter_map(|(q, pixel)| Some((*q, point(*pixel)?))).collect())
}
