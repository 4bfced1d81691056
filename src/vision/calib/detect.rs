//! Detects the corners of the board in a picture, with sub-pixel accuracy.
//!
//! `chessboard` and `charuco` find the corners to about a pixel, and `placing` refines them to a hundredth of a pixel;
//! `circles` does both.

use super::board::Board;
pub use super::board::Corners;
use super::chain::BoardObservation;
use super::charuco;
use super::chessboard::{self, Search};
use super::circles;
use super::error::CalibError;
use super::placing;
pub use super::placing::DetectedCorners;
use super::print::Print;
use panelprep_base::geometry::{Frame, GrayPicture, OrganizedCloud, Pixel, Point, Vector, local_plane};

/// Detects the corners of the board. `half_window_px` replaces the default window; `name` is the name of the picture in
/// messages.
///
/// # Errors
/// If the picture does not show the board, shows another board, or too little of a ChArUco board.
pub fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    half_window_px: Option<usize>,
) -> Result<DetectedCorners, CalibError> {
    if let Some(markers) = board.markers() {
        return charuco::detect(name, picture, board, markers, half_window_px);
    }
    if let Some(asymmetric) = board.circles() {
        return circles::detect(name, picture, board, asymmetric, &chessboard::reduction_factors(picture));
    }
    let (picture_name, columns, rows) = (name.to_owned(), board.columns(), board.rows());
    let rough = match chessboard::find(picture, board)? {
        Search::Board(rough) => rough,
        Search::Other(found) => return Err(CalibError::OtherBoard { picture: picture_name, found, columns, rows }),
        Search::Nothing => return Err(CalibError::NoBoard { picture: picture_name, columns, rows }),
    };
    let all: Vec<_> = board.corners().into_iter().zip(&rough).collect();
    if half_window_px.is_some() {
        let seen: Corners = all.iter().filter(|(_, node)| node.is_seen).map(|(q, node)| (*q, node.pixel)).collect();
        return Ok(placing::refine_subpix(picture, &seen, board.square_mm(), half_window_px)?);
    }
    let corners: Corners = all.iter().map(|(q, node)| (*q, node.pixel)).collect();
    let found = placing::refine_subpix(picture, &corners, board.square_mm(), None)?;
    let is_seen: Vec<bool> = rough.iter().map(|node| node.is_seen).collect();
    let found = placing::refine_with_model(picture, board, found, &is_seen, &Print::from_board(board, &[]));
    // If most corners cannot be located, the board is in the picture but cannot be used.
    if 2 * found.corners.len() < board.count() {
        return Err(CalibError::NoBoard { picture: picture_name, columns, rows });
    }
    Ok(found)
}

/// Half side of the neighbourhood from which the 3D point of a corner is computed, px.
const PLANE_WINDOW_HALF_PX: usize = 8;

/// Returns the corners that the 3D camera measured: the ray at each corner meets the plane through the points around
/// it. Corners with too few points are omitted.
pub fn measured<C: Frame>(
    cloud: &OrganizedCloud<C>,
    camera: &panelprep_base::geometry::PinholeCamera,
    corners: &Corners,
) -> BoardObservation<C> {
    let origin = Point::at(0.0, 0.0, 0.0);
    let point = |pixel: Pixel| {
        let at = pixel.nearest_whole(cloud.width(), cloud.height())?;
        let ray: Vector<C> = camera.unproject(pixel)?;
        local_plane(cloud, at, PLANE_WINDOW_HALF_PX, origin)?.intersect_ray(origin, ray)
    };
    BoardObservation::Points(corners.iter().filter_map(|(q, pixel)| Some((*q, point(*pixel)?))).collect())
}
